"""Registers two numpy arrays by a saltus daemon, with plain grpcio. Usage: register.py unix:/run/saltusd/socket
Stubs, once: protoc -I PREFIX/share/saltus/proto --python_out=. --grpc_out=. --plugin=protoc-gen-grpc=$(which \
grpc_python_plugin) saltus/v1/registration.proto"""
import hashlib, sys
import grpc, numpy
from saltus.v1 import registration_pb2 as saltus, registration_pb2_grpc as services

channel = grpc.insecure_channel(sys.argv[1])
jobs, blobs = services.RegistrationServiceStub(channel), services.BlobServiceStub(channel)
END = b"ElementDataFile = LOCAL\n"

def upload(image):  # an array [y, x], pixels of 1 mm, as a MetaImage; pieces have at most 2 MiB
    content = ("ObjectType = Image\nNDims = 2\nBinaryData = True\nElementSpacing = 1 1\nDimSize = %d %d\n"
               "ElementType = MET_FLOAT\n" % image.shape[::-1]).encode() + END + image.astype("<f4").tobytes()
    digest = "sha256:" + hashlib.sha256(content).hexdigest()
    pieces = (content[at:at + 2**21] for at in range(0, len(content), 2**21))
    blobs.WriteBlob(saltus.WriteBlobRequest(data=piece, **({"digest": digest, "size": len(content)} if i == 0 else {}))
                    for i, piece in enumerate(pieces))
    return saltus.InputFile(digest=digest, format="mha")

# Two blobs; in the moving image they lie 3 mm farther along x, so that is what the displacement should be.
y, x = numpy.mgrid[0:48, 0:48]
scene = lambda shift: sum(numpy.exp(-((x - cx - shift)**2 + (y - cy)**2) / 60) for cx, cy in ((16, 18), (30, 28)))
spec = saltus.RegistrationSpec(fixed=upload(scene(0)), moving=upload(scene(3)), output_format="mha", model="gaussian",
                               similarity="ssd", preset="fast", settings={"regularisation": "0.0001"})
job = jobs.CreateRegistrationJob(saltus.CreateRegistrationJobRequest(spec=spec))
for event in jobs.WatchRegistrationJob(saltus.WatchRegistrationJobRequest(id=job.id)):
    job = event.job  # state and progress; the stream ends with the job
assert job.state == saltus.JOB_STATE_SUCCEEDED, job.failure.message
digest = next(artifact.digest for artifact in job.artifacts if artifact.name == "displacement.mha")
content = b"".join(piece.data for piece in blobs.ReadBlob(saltus.ReadBlobRequest(digest=digest)))
displacement = numpy.frombuffer(content.split(END, 1)[1], "<f4").reshape(48, 48, 2)  # mm, x first
print("displacement at the first blob:", displacement[18, 16])
