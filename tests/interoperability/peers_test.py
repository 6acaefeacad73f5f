"""Transforms and points exchanged with elastix's transformix and with plastimatch, both ways.

What saltus finds is handed to the other program as it is; points and images that the other program carries through it must
be those that saltus makes. And a field that the other program writes must mean the same to saltus. ITK itself is held to the
same in tests/integration/image_io. A program that is not installed is left out; without any, the test is skipped.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

try:
    import numpy
except ImportError as error:
    print(f"SKIPPED: {error}; install python3-numpy")
    sys.exit(0)

options = None
# Voxel centres, since plastimatch takes the nearest voxel's displacement for points, and one place between voxels.
CENTRES = [[20.0, 30.0, 26.0], [40.0, 40.0, 40.0], [34.0, 22.0, 30.0]]
BETWEEN = CENTRES + [[33.3, 21.7, 30.1]]
SHIFT = [4.0, -3.0, 2.0]
# World axes of a grid: along the grid's own, and turned by a quarter with the third one reversed.
GEOMETRIES = {"straight": ("1 0 0 0 1 0 0 0 1", "0 0 0"), "turned": ("0 1 0 -1 0 0 0 0 -1", "70 -5 66")}


def run(*command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if done.returncode != 0:
        raise AssertionError(f"{command} ended with {done.returncode}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def split(file):
    """Header fields and voxels of a MetaImage with its data inside."""
    with open(file, "rb") as opened:
        content = opened.read()
    end = content.index(b"ElementDataFile = LOCAL\n") + len(b"ElementDataFile = LOCAL\n")
    fields = dict(line.split(" = ", 1) for line in content[:end].decode().strip().split("\n"))
    return fields, content[end:]


def voxels(file):
    fields, data = split(file)
    assert fields["ElementType"] == "MET_FLOAT", fields
    size = [int(n) for n in fields["DimSize"].split()]
    return numpy.frombuffer(data, "<f4").reshape(size[::-1])


def place(file, geometry):
    """Gives an image other axes and another origin; its voxels stay."""
    fields, data = split(file)
    fields["TransformMatrix"], fields["Offset"] = GEOMETRIES[geometry]
    fields.pop("AnatomicalOrientation", None)
    last = fields.pop("ElementDataFile")
    with open(file, "wb") as opened:
        for name, value in fields.items():
            opened.write(f"{name} = {value}\n".encode())
        opened.write(f"ElementDataFile = {last}\n".encode() + data)


def to_world(points, geometry):
    """Positions of a straight grid with its origin at 0, in another geometry."""
    matrix, offset = ([float(n) for n in text.split()] for text in GEOMETRIES[geometry])
    # MetaImage writes the direction of each grid axis in turn.
    return (numpy.array(points) @ numpy.array(matrix).reshape(3, 3) + numpy.array(offset)).tolist()


class Exchange:
    """A registration's result in one geometry, and what every program makes of it."""
    geometry = None

    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = cls.scratch.name
        cls.saltus("phantom", "smooth", "--dimension", 3, "--size", "40,36,32", "--spacing", 2, "--out", cls.at("pair"))
        for name in ("fixed", "moving"):
            place(cls.at(f"pair/{name}.mha"), cls.geometry)
        cls.saltus("register", "--fixed", cls.at("pair/fixed.mha"), "--moving", cls.at("pair/moving.mha"), "--model",
                   "gaussian", "--similarity", "ssd", "--preset", "fast", "--threads", 1, "--format", "mha", "--out",
                   cls.at("result"))

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    @classmethod
    def saltus(cls, *words):
        return run(options.saltus, *words)

    @classmethod
    def at(cls, name):
        return os.path.join(cls.folder, name)

    def carried(self, points, transform):
        """By saltus."""
        with open(self.at("in.csv"), "w") as file:
            file.write("x,y,z\n" + "".join(f"{x},{y},{z}\n" for x, y, z in points))
        self.saltus("points", "--transform", transform, "--in", self.at("in.csv"), "--out", self.at("out.csv"))
        with open(self.at("out.csv")) as file:
            return [[float(n) for n in line.split(",")] for line in file.read().split()[1:]]

    def inside(self, image):
        return image[4:-4, 4:-4, 4:-4]

    def expect_near(self, found, expected, tolerance):
        self.assertEqual(numpy.shape(found), numpy.shape(expected))
        self.assertLess(numpy.abs(numpy.array(found) - numpy.array(expected)).max(), tolerance)

    def expect_moved(self, points):
        self.assertGreater(numpy.abs(numpy.array(self.carried(points, self.at("result"))) - numpy.array(points)).max(), 1)

    def transformix(self, transform, points, folder):
        fields, _ = split(self.at("pair/fixed.mha"))
        parameters = f"""{transform}
(InitialTransformParametersFileName "NoInitialTransform")
(HowToCombineTransforms "Compose")
(FixedImageDimension 3)
(MovingImageDimension 3)
(FixedInternalImagePixelType "float")
(MovingInternalImagePixelType "float")
(Size {fields["DimSize"]})
(Index 0 0 0)
(Spacing {fields["ElementSpacing"]})
(Origin {fields["Offset"]})
(Direction {fields["TransformMatrix"]})
(UseDirectionCosines "true")
(ResampleInterpolator "FinalBSplineInterpolator")
(FinalBSplineInterpolationOrder 1)
(Resampler "DefaultResampler")
(DefaultPixelValue 0)
(ResultImageFormat "mha")
(ResultImagePixelType "float")
(CompressResultImage "false")
"""
        os.mkdir(self.at(folder))
        with open(self.at(f"{folder}/parameters.txt"), "w") as file:
            file.write(parameters)
        if points != "all":
            with open(self.at(f"{folder}/points.txt"), "w") as file:
                file.write(f"point\n{len(points)}\n" + "".join(f"{x} {y} {z}\n" for x, y, z in points))
            points = self.at(f"{folder}/points.txt")
        run("transformix", "-tp", self.at(f"{folder}/parameters.txt"), "-def", points, "-in",
            self.at("pair/moving.mha"), "-out", self.at(folder))

    @unittest.skipUnless(shutil.which("transformix"), "transformix is not installed")
    def test_transformix_carries_points_and_images_as_saltus_does(self):
        points = to_world(BETWEEN, self.geometry)
        self.expect_moved(points)
        self.transformix(
            f'(Transform "DeformationFieldTransform")\n(NumberOfParameters 0)\n'
            f'(DeformationFieldFileName "{self.at("result/displacement.mha")}")\n(DeformationFieldInterpolationOrder 1)',
            points, "by_transformix")
        found = []
        with open(self.at("by_transformix/outputpoints.txt")) as file:
            for line in file:
                found.append([float(n) for n in line.split("OutputPoint = [")[1].split("]")[0].split()])
        self.expect_near(found, self.carried(points, self.at("result")), 1e-5)  # of which it prints six digits
        self.expect_near(self.inside(voxels(self.at("by_transformix/result.mha"))),
                         self.inside(voxels(self.at("result/warped.mha"))), 1e-3)  # of intensities up to 250

    @unittest.skipUnless(shutil.which("transformix"), "transformix is not installed")
    def test_saltus_reads_fields_of_transformix(self):
        self.transformix(
            f'(Transform "TranslationTransform")\n(NumberOfParameters 3)\n'
            f'(TransformParameters {SHIFT[0]} {SHIFT[1]} {SHIFT[2]})', "all", "of_transformix")
        points = to_world(BETWEEN, self.geometry)
        self.expect_near(self.carried(points, self.at("of_transformix/deformationField.mha")),
                         (numpy.array(points) + SHIFT).tolist(), 1e-4)

    @unittest.skipUnless(shutil.which("plastimatch"), "plastimatch is not installed")
    def test_plastimatch_carries_points_and_images_as_saltus_does(self):
        field = self.at("result/displacement.mha")
        run("plastimatch", "warp", "--input", self.at("pair/moving.mha"), "--xf", field, "--fixed",
            self.at("pair/fixed.mha"), "--interpolation", "linear", "--output-img", self.at("by_plastimatch.mha"))
        self.expect_near(self.inside(voxels(self.at("by_plastimatch.mha"))),
                         self.inside(voxels(self.at("result/warped.mha"))), 1e-3)
        points = to_world(CENTRES, self.geometry)
        self.expect_moved(points)
        # Slicer's fiducials are RAS.
        with open(self.at("in.fcsv"), "w") as file:
            file.write(f"# name = f\n# numPoints = {len(points)}\n")
            file.write("".join(f"f{i},{-x},{-y},{z},1,1\n" for i, (x, y, z) in enumerate(points)))
        run("plastimatch", "warp", "--input", self.at("in.fcsv"), "--xf", field, "--output-pointset",
            self.at("out.fcsv"))
        found = []
        with open(self.at("out.fcsv")) as file:
            for line in file:
                if not line.startswith("#"):
                    x, y, z = (float(n) for n in line.split(",")[1:4])
                    found.append([-x, -y, z])
        self.expect_near(found, self.carried(points, self.at("result")), 1e-4)

    @unittest.skipUnless(shutil.which("plastimatch"), "plastimatch is not installed")
    def test_saltus_reads_fields_of_plastimatch(self):
        run("plastimatch", "synth-vf", "--fixed", self.at("pair/fixed.mha"), "--xf-trans",
            " ".join(str(n) for n in SHIFT), "--output", self.at("of_plastimatch.mha"))
        points = to_world(BETWEEN, self.geometry)
        self.expect_near(self.carried(points, self.at("of_plastimatch.mha")), (numpy.array(points) + SHIFT).tolist(),
                         1e-4)


class Straight(Exchange, unittest.TestCase):
    geometry = "straight"


class Turned(Exchange, unittest.TestCase):
    geometry = "turned"


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--saltus", required=True)
    options = parser.parse_args()
    if not shutil.which("transformix") and not shutil.which("plastimatch"):
        print("SKIPPED: neither transformix nor plastimatch is installed (packages elastix, plastimatch)")
        sys.exit(0)
    unittest.main(argv=sys.argv[:1])
