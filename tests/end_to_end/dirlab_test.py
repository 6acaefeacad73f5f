"""`saltus dirlab` on a pack in DIR-Lab's layout that is made from a phantom: voxels, indices from 1, names and folders."""

import argparse
import json
import os
import subprocess
import sys
import tempfile

try:
    import numpy
except ImportError as error:
    print(f"SKIPPED: {error}; install python3-numpy")
    sys.exit(0)

parser = argparse.ArgumentParser()
parser.add_argument("--saltus", required=True)
options = parser.parse_args()

SIZE, SPACING = (256, 256, 94), (0.97, 0.97, 2.5)


def run(*words, expect=0):
    done = subprocess.run([options.saltus, *words], capture_output=True, text=True)
    assert done.returncode == expect, f"{words} ended with {done.returncode}: {done.stdout}{done.stderr}"
    return done


def voxels(file):
    with open(file, "rb") as opened:
        content = opened.read()
    end = content.index(b"ElementDataFile = LOCAL\n") + len(b"ElementDataFile = LOCAL\n")
    return numpy.frombuffer(content[end:], "<f4")


def points(file):
    return numpy.loadtxt(file, delimiter=",", skiprows=1)


with tempfile.TemporaryDirectory() as folder:
    at = lambda name: os.path.join(folder, name)
    run("phantom", "thorax", "--size", ",".join(map(str, SIZE)), "--spacing", ",".join(map(str, SPACING)), "--noise",
        "0", "--out", at("phantom"))
    origin = numpy.array(json.load(open(at("phantom/phantom.json"), encoding="utf-8"))["origin_mm"])
    os.makedirs(at("packs/Case1Pack/Images"))
    os.makedirs(at("packs/Case1Pack/ExtremePhases"))
    indices = {}
    for image, phase in (("fixed", "T00"), ("moving", "T50")):
        # DIR-Lab's voxels are HU + 1000.
        raw = numpy.round(voxels(at(f"phantom/{image}.mha")) + 1000).astype("<i2")
        raw.tofile(at(f"packs/Case1Pack/Images/case1_{phase}_s.img"))
        indices[phase] = numpy.round((points(at(f"phantom/{image}_points.csv")) - origin) / SPACING) + 1
    inside = numpy.all([(indices[phase] >= 1) & (indices[phase] <= SIZE) for phase in indices], axis=(0, 2))
    for phase in indices:
        indices[phase] = indices[phase][inside][:300]
        numpy.savetxt(at(f"packs/Case1Pack/ExtremePhases/Case1_300_{phase}_xyz.txt"), indices[phase], fmt="%d",
                      delimiter="\t")
    before = numpy.linalg.norm((indices["T00"] - indices["T50"]) * SPACING, axis=1).mean()
    assert 3 < before < 15, before

    # These are not the landmarks that everybody has, so nothing is registered.
    refused = run("dirlab", "--root", at("packs"), "--cases", "1", "--out", at("out"), expect=2)
    assert "not those of DIR-Lab" in refused.stderr, refused.stderr
    assert not os.path.exists(at("out"))

    command = ("dirlab", "--root", at("packs"), "--cases", "1", "--initial-errors", f"{before:.2f}", "--models",
               "gaussian,wendland", "--similarity", "ssd", "--preset", "fast", "--set", "levels=4", "--set",
               "finest_level=3", "--threads", "1", "--out", at("out"), "--json")
    table = json.loads(run(*command).stdout)
    assert abs(table["before_mm"]["case01"] - before) < 1e-6
    for model, paper in (("gaussian", 0.84), ("wendland", 0.83)):
        case = table["models"][model]["cases"]["case01"]
        assert case["paper_mm"] == paper
        assert case["raw_mm"]["n"] == len(indices["T00"])
        assert case["raw_mm"]["mean"] < 0.7 * before, case
        assert abs(case["snapped_mm"]["mean"] - case["raw_mm"]["mean"]) < 1, case
        assert table["models"][model]["pooled"]["raw_mm"] == case["raw_mm"]
        # The registration's own report has found the same errors.
        report = json.load(open(at(f"out/{model}/case01/report.json"), encoding="utf-8"))
        assert abs(report["landmark_error_mm"]["after"]["mean"] - case["raw_mm"]["mean"]) < 1e-4
        assert abs(report["landmark_error_mm"]["before"]["mean"] - before) < 1e-4
    assert 0 <= table["models"]["gaussian"]["wilcoxon_against_wendland"]["p"] <= 1

    again = run(*command)
    assert again.stderr.count("1 of 1 pairs are done already") == 2, again.stderr
    assert json.loads(again.stdout) == table
    print(f"before {before:.2f} mm, gaussian {table['models']['gaussian']['pooled']['raw_mm']['mean']:.2f} mm")
