"""`saltus study paper --quick`: every figure, and a table whose numbers are computed again from the fields."""

import argparse
import array
import json
import math
import os
import struct
import subprocess
import sys
import tempfile
import zlib

parser = argparse.ArgumentParser()
parser.add_argument("--saltus", required=True)
options = parser.parse_args()


def run(*words, expect=0):
    done = subprocess.run([options.saltus, *words], capture_output=True, text=True)
    assert done.returncode == expect, f"{words} ended with {done.returncode}: {done.stdout}{done.stderr}"
    return done


def samples(file):
    """Header and samples of a MetaImage, without anything of saltus."""
    with open(file, "rb") as opened:
        content = opened.read()
    end = content.index(b"ElementDataFile = LOCAL\n") + len(b"ElementDataFile = LOCAL\n")
    header = dict(line.split(" = ", 1) for line in content[:end].decode().splitlines())
    values = array.array({"MET_FLOAT": "f", "MET_UCHAR": "B"}[header["ElementType"]])
    values.frombytes(zlib.decompress(content[end:]) if header.get("CompressedData") == "True" else content[end:])
    return header, values


def errors(found, true, mask):
    return [math.hypot(found[2 * i] - true[2 * i], found[2 * i + 1] - true[2 * i + 1])
            for i in range(len(mask)) if mask[i]]


def size_of_png(file):
    with open(file, "rb") as opened:
        start = opened.read(24)
    assert start[:8] == b"\x89PNG\r\n\x1a\n", file
    return struct.unpack(">II", start[16:])


with tempfile.TemporaryDirectory() as folder:
    at = lambda name: os.path.join(folder, "paper", name)
    command = ("study", "paper", "--quick", "--out", at("."), "--json")
    told = run(*command)
    table = json.loads(told.stdout)
    assert "lung figures are left out" in told.stderr, told.stderr
    assert table == json.load(open(at("study.json"), encoding="utf-8"))
    assert len(table["scenes"]) == 10

    for scene in ("rectangle", "wheel"):
        rows = {row["model"]: row for row in table["scenes"] if row["scene"] == scene}
        true = samples(at(f"scenes/{scene}/truth.mha"))[1]
        valid, near = (samples(at(f"scenes/{scene}/mask_{name}.mha"))[1] for name in ("valid", "near"))
        both = [a and b for a, b in zip(valid, near)]
        assert sum(1 for v in both if v) > 100
        fields = {"before": [0.0] * len(true), "true field": true}
        for model in ("gaussian", "wendland", "wendland1"):
            fields[model] = samples(at(f"runs/{scene}-{model}/displacement.mha"))[1]
            report = json.load(open(at(f"runs/{scene}-{model}/report.json"), encoding="utf-8"))
            assert rows[model]["cpu_seconds"] == report["seconds"]["cpu"]
            assert report["model"] == model and report["similarity"] == "ssd"
        for name, field in fields.items():
            for key, mask in (("error_px", valid), ("error_near_px", both)):
                list_of_errors = errors(field, true, mask)
                mean = sum(list_of_errors) / len(list_of_errors)
                assert abs(rows[name][key]["mean"] - mean) < 1e-5, (scene, name, key, rows[name][key], mean)
                assert abs(rows[name][key]["max"] - max(list_of_errors)) < 1e-5
                assert rows[name][key]["n"] == len(list_of_errors)
        assert rows["true field"]["error_px"]["mean"] == 0
        # Each model finds most of the motion, and what jumps finds more of it beside the jump.
        assert rows["wendland1"]["error_px"]["mean"] < 0.3 * rows["before"]["error_px"]["mean"], rows
        assert rows["wendland1"]["error_near_px"]["mean"] < rows["gaussian"]["error_near_px"]["mean"], rows

    # 6 px of slip, in closed form: a jump between two rows goes from 10 to 90 % within 0.8 of their distance.
    rows = {row["model"]: row for row in table["scenes"] if row["scene"] == "rectangle"}
    assert abs(rows["true field"]["jump_px"] - 6) < 1e-5 and abs(rows["true field"]["width_px"] - 0.8) < 1e-5, rows
    assert abs(rows["wendland1"]["jump_px"] - 6) < 0.3 and rows["wendland1"]["width_px"] < 2, rows
    assert rows["gaussian"]["width_px"] > 1.5 * rows["wendland1"]["width_px"], rows

    page = open(at("study.html"), encoding="utf-8").read()
    figures = ("elementary", "kernels_1d", "kernels_2d", "rectangle", "rectangle_difference", "wheel", "wheel_difference")
    assert sorted(os.listdir(at("figures"))) == sorted(f"{name}.png" for name in figures)
    for name in figures:
        width, height = size_of_png(at(f"figures/{name}.png"))
        assert width > 600 and height > 300, (name, width, height)
    assert page.count("<img") == len(figures) and page.count("data:image/png;base64,") == len(figures)
    assert "http:" not in page and "https:" not in page and "<script" not in page

    # Again: nothing is registered, and everything is as it was.
    again = run(*command)
    assert "6 of 6 pairs are done already" in again.stderr, again.stderr
    assert json.loads(again.stdout) == table

    refused = run("study", "liver", "--data", folder, "--out", at("liver"), expect=2)
    assert "no folder liver_mri" in refused.stderr, refused.stderr
    print({name: row["error_px"]["mean"] for name, row in rows.items()})
