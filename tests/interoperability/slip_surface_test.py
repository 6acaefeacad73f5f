"""interface.vtp and interface.csv of a registration, read by others.

The VTK file is read with an XML parser, by the format's own rules, and with VTK and meshio where they are installed. The CSV
file, the report and the phantom's truth (a line whose place, direction and slip are known) say what has to be in it.
"""

import argparse
import csv
import json
import math
import os
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree

options = None
ANGLE = 30
SLIP = 6
SIZE = 96


def run(*command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if done.returncode != 0:
        raise AssertionError(f"{command} ended with {done.returncode}: {done.stdout[-2000:]}{done.stderr[-2000:]}")


def polydata(file):
    """Points, vertices and point data of an ASCII .vtp, with their declared sizes checked."""
    root = xml.etree.ElementTree.parse(file).getroot()
    assert root.tag == "VTKFile" and root.attrib["type"] == "PolyData", root.attrib
    piece = root.find("PolyData/Piece")

    def values(array):
        assert array.attrib["format"] == "ascii", array.attrib
        kind = {"Float64": float, "Int64": int}[array.attrib["type"]]
        flat = [kind(word) for word in (array.text or "").split()]
        width = int(array.attrib.get("NumberOfComponents", 1))
        assert len(flat) % width == 0
        return [flat[i:i + width] for i in range(0, len(flat), width)]

    points = values(piece.find("Points/DataArray"))
    assert len(points) == int(piece.attrib["NumberOfPoints"])
    verts = {array.attrib["Name"]: [row[0] for row in values(array)] for array in piece.find("Verts")}
    assert len(verts["offsets"]) == int(piece.attrib["NumberOfVerts"])
    data = {array.attrib["Name"]: values(array) for array in piece.find("PointData")}
    for name, rows in data.items():
        assert len(rows) == len(points), name
    return points, verts, data


class SlipSurface(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory(prefix="saltus-slip-")
        cls.folder = cls.temporary.name
        scene = os.path.join(cls.folder, "scene")
        run(options.saltus, "phantom", "slip", "--size", f"{SIZE},{SIZE}", "--angle", ANGLE, "--slip", SLIP, "--out", scene)
        for name, settings in (("slides", ["--model", "sliding", "--set", "orientations=8"]), ("smooth", ["--model", "gaussian"])):
            run(options.saltus, "register", "--fixed", cls.image(scene, "fixed"), "--moving", cls.image(scene, "moving"),
                "--similarity", "ssd", "--threads", 1, *settings, "--out", os.path.join(cls.folder, name))

    @staticmethod
    def image(folder, name):
        return next(os.path.join(folder, file) for file in sorted(os.listdir(folder)) if file.startswith(name + "."))

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def rows(self, name):
        with open(os.path.join(self.folder, name, "interface.csv"), newline="") as file:
            return list(csv.DictReader(file))

    def report(self, name):
        with open(os.path.join(self.folder, name, "report.json")) as file:
            return json.load(file)

    def test_the_table_holds_the_line(self):
        rows = [{key: float(value) for key, value in row.items()} for row in self.rows("slides")]
        main = [row for row in rows if row["part"] == 0]
        self.assertEqual(set(rows[0]), {"x", "y", "normal_x", "normal_y", "length_mm", "jump_x", "jump_y", "jump_mm", "gap_mm",
                                        "velocity_jump_mm", "part"})
        length = sum(row["length_mm"] for row in main)
        self.assertAlmostEqual(length, SIZE / math.cos(math.radians(ANGLE)), delta=0.08 * SIZE)
        mean = sum(row["jump_mm"] * row["length_mm"] for row in main) / length
        self.assertAlmostEqual(mean, SLIP, delta=0.15 * SLIP)
        for row in main:
            self.assertAlmostEqual(math.hypot(row["normal_x"], row["normal_y"]), 1, delta=1e-6)
            self.assertAlmostEqual(math.hypot(row["jump_x"], row["jump_y"]), row["jump_mm"], delta=1e-5)
        report = self.report("slides")["slip_surface"]
        self.assertEqual(report["points"], len(rows))
        self.assertAlmostEqual(report["length_mm"], sum(row["length_mm"] for row in rows), delta=1e-3)
        self.assertEqual(report["parts"], 1 + max(row["part"] for row in rows))

    def test_the_vtk_file_holds_the_same(self):
        rows = self.rows("slides")
        points, verts, data = polydata(os.path.join(self.folder, "slides", "interface.vtp"))
        self.assertEqual(len(points), len(rows))
        self.assertEqual(verts["connectivity"], list(range(len(rows))))
        self.assertEqual(verts["offsets"], list(range(1, len(rows) + 1)))
        for i, row in enumerate(rows):
            self.assertEqual(points[i], [float(row["x"]), float(row["y"]), 0])
            self.assertEqual(data["Normals"][i], [float(row["normal_x"]), float(row["normal_y"]), 0])
            self.assertEqual(data["jump"][i], [float(row["jump_x"]), float(row["jump_y"]), 0])
            for name in ("length_mm", "jump_mm", "gap_mm", "velocity_jump_mm", "part"):
                self.assertEqual(data[name][i], [float(row[name])], name)

    def test_what_is_smooth_has_files_without_points(self):
        self.assertEqual(self.rows("smooth"), [])
        points, verts, data = polydata(os.path.join(self.folder, "smooth", "interface.vtp"))
        self.assertEqual((points, verts["offsets"], data["jump_mm"]), ([], [], []))
        self.assertEqual(self.report("smooth")["slip_surface"]["points"], 0)
        with open(os.path.join(self.folder, "smooth", "report.html")) as file:
            self.assertIn("No sliding interface found", file.read())

    def test_vtk_reads_it(self):
        try:
            from vtkmodules.vtkIOXML import vtkXMLPolyDataReader
        except ImportError:
            self.skipTest("python3-vtk9 is not installed")
        for name in ("slides", "smooth"):
            reader = vtkXMLPolyDataReader()
            reader.SetFileName(os.path.join(self.folder, name, "interface.vtp"))
            reader.Update()
            output = reader.GetOutput()
            self.assertEqual(output.GetNumberOfPoints(), len(self.rows(name)))
            self.assertEqual(output.GetNumberOfVerts(), len(self.rows(name)))
            for i, row in enumerate(self.rows(name)):
                self.assertAlmostEqual(output.GetPoint(i)[0], float(row["x"]), delta=1e-4)
                self.assertAlmostEqual(output.GetPointData().GetArray("jump_mm").GetValue(i), float(row["jump_mm"]), delta=1e-6)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--saltus", required=True)
    options, rest = parser.parse_known_args()
    unittest.main(argv=[sys.argv[0], *rest], verbosity=2)
