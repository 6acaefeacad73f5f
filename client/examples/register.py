"""Registers two numpy arrays by a saltus daemon, with grpcio alone.

Make the stubs once, in a folder on PYTHONPATH:
    protoc -I PREFIX/share/saltus/proto --python_out=. --grpc_out=. \\
        --plugin=protoc-gen-grpc=$(which grpc_python_plugin) saltus/v1/registration.proto
Usage: register.py ADDRESS      (unix:/run/saltusd/socket or host:port)
"""

import hashlib
import sys

import grpc
import numpy
from saltus.v1 import registration_pb2 as saltus
from saltus.v1 import registration_pb2_grpc as services


def to_mha(image, spacing):
    """An array [y, x] or [z, y, x] as a MetaImage. What comes first in the file runs fastest: x."""
    axes = image.ndim
    header = (f"ObjectType = Image\nNDims = {axes}\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
              f"TransformMatrix = {' '.join(str(int(i == j)) for i in range(axes) for j in range(axes))}\n"
              f"Offset = {' '.join(['0'] * axes)}\nElementSpacing = {' '.join(map(str, spacing))}\n"
              f"DimSize = {' '.join(map(str, image.shape[::-1]))}\nElementType = MET_FLOAT\nElementDataFile = LOCAL\n")
    return header.encode() + image.astype("<f4").tobytes()


def from_mha(content):
    """The voxels of an uncompressed MetaImage of floats, components last."""
    end = content.index(b"ElementDataFile = LOCAL\n") + len(b"ElementDataFile = LOCAL\n")
    fields = dict(line.split(" = ", 1) for line in content[:end].decode().strip().split("\n"))
    size = [int(n) for n in fields["DimSize"].split()][::-1]
    return numpy.frombuffer(content[end:], "<f4").reshape(size + [int(fields.get("ElementNumberOfChannels", 1))])


class Service:

    def __init__(self, address):
        channel = grpc.insecure_channel(address)
        self.jobs = services.RegistrationServiceStub(channel)
        self.blobs = services.BlobServiceStub(channel)

    def upload(self, content, file_format):
        digest = "sha256:" + hashlib.sha256(content).hexdigest()

        def requests():
            yield saltus.WriteBlobRequest(digest=digest, size=len(content))
            for at in range(0, len(content), 1 << 20):
                yield saltus.WriteBlobRequest(data=content[at:at + (1 << 20)])

        if self.blobs.FindMissingBlobs(saltus.FindMissingBlobsRequest(digests=[digest])).missing:
            self.blobs.WriteBlob(requests())
        return saltus.InputFile(digest=digest, format=file_format)

    def download(self, artifact):
        return b"".join(piece.data for piece in self.blobs.ReadBlob(saltus.ReadBlobRequest(digest=artifact.digest)))

    def register(self, fixed, moving, **options):
        """The job in its last state; options are fields of RegistrationSpec."""
        spec = saltus.RegistrationSpec(fixed=fixed, moving=moving, output_format="mha", **options)
        job = self.jobs.CreateRegistrationJob(saltus.CreateRegistrationJobRequest(spec=spec))
        for event in self.jobs.WatchRegistrationJob(saltus.WatchRegistrationJobRequest(id=job.id)):
            job = event.job
        if job.state != saltus.JOB_STATE_SUCCEEDED:
            raise RuntimeError(f"{job.failure.reason}: {job.failure.message}")
        return {artifact.name: artifact for artifact in job.artifacts}


def main():
    service = Service(sys.argv[1])
    # Two blobs; in the moving image they lie 3 mm farther along x, so that is what the displacement should be.
    y, x = numpy.mgrid[0:48, 0:48].astype(float)
    scene = lambda shift: sum(numpy.exp(-((x - cx - shift)**2 + (y - cy)**2) / 60) for cx, cy in ((16, 18), (30, 28)))
    fixed, moving = (service.upload(to_mha(scene(shift), (1, 1)), "mha") for shift in (0, 3))
    files = service.register(fixed, moving, model="gaussian", similarity="ssd", preset="fast",
                             settings={"regularisation": "0.0001"})
    displacement = from_mha(service.download(files["displacement.mha"]))
    print("displacement at the first blob:", displacement[18, 16])


if __name__ == "__main__":
    main()
