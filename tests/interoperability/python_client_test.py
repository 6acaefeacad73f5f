"""A client that shares no line with ours: Python's grpcio and stubs made from the .proto files.

It starts a daemon on a unix socket, speaks to every part of the protocol that a client needs, looks at the codes of
refusals, and sends bytes that are no message to every method. The daemon is a child of this test and ends with it.
"""

import argparse
import hashlib
import os
import random
import subprocess
import sys
import tempfile
import unittest

try:
    import google.protobuf
    import grpc
except ImportError as error:
    print(f"SKIPPED: {error}; install python3-grpcio and python3-protobuf")
    sys.exit(0)

options = None
stubs = None


def make_stubs(folder):
    """Imports the modules that protoc makes of the service's files."""
    files = ["saltus/v1/registration.proto", "saltus/v1/worker.proto"]
    files += [
        f"saltus/v1/{name}" for name in sorted(os.listdir(os.path.join(options.proto, "saltus/v1")))
        if name.endswith(".proto") and f"saltus/v1/{name}" not in files
    ]
    subprocess.run(
        [
            options.protoc, f"--proto_path={options.proto}", f"--python_out={folder}", f"--grpc_out={folder}",
            f"--plugin=protoc-gen-grpc={options.plugin}", *files
        ],
        check=True)
    sys.path.insert(0, folder)
    modules = {}
    for file in files:
        name = file.removesuffix(".proto").replace("/", ".")
        for suffix in ("_pb2", "_pb2_grpc"):
            modules[os.path.basename(file).removesuffix(".proto") + suffix] = __import__(name + suffix, fromlist=["x"])
    return modules


def digest_of(data):
    return "sha256:" + hashlib.sha256(data).hexdigest()


def reason_of(call_error):
    return dict(call_error.trailing_metadata() or ()).get("saltus-reason")


class PythonClient(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        # Stands in for the worker: it ends at once without a word, so jobs stay in the daemon's hands.
        worker = os.path.join(cls.folder.name, "worker")
        with open(worker, "w", encoding="ascii") as file:
            file.write("#!/bin/sh\nexit 1\n")
        os.chmod(worker, 0o700)
        cls.daemon = subprocess.Popen(
            [options.daemon, "--data", os.path.join(cls.folder.name, "data"), "--worker", worker, "--slots", "1",
             "--log-level", "error"],
            stdout=subprocess.PIPE, text=True)
        cls.address = cls.daemon.stdout.readline().strip().removeprefix("listening on ")
        cls.channel = grpc.insecure_channel(cls.address)
        cls.messages = stubs["registration_pb2"]
        services = stubs["registration_pb2_grpc"]
        cls.jobs = services.RegistrationServiceStub(cls.channel)
        cls.blobs = services.BlobServiceStub(cls.channel)
        cls.info = services.ServerInfoServiceStub(cls.channel)

    @classmethod
    def tearDownClass(cls):
        cls.channel.close()
        cls.daemon.terminate()
        code = cls.daemon.wait(60)
        cls.daemon.stdout.close()
        cls.folder.cleanup()
        assert code == 0, f"the daemon ended with {code}"

    def upload(self, data, digest=None, piece=1 << 20):
        first = self.messages.WriteBlobRequest(digest=digest or digest_of(data), size=len(data))
        rest = (self.messages.WriteBlobRequest(data=data[at:at + piece]) for at in range(0, len(data), piece))

        def requests():
            yield first
            yield from rest

        return self.blobs.WriteBlob(requests(), timeout=60)

    def spec(self):
        fixed, moving = b"fixed of python", b"moving of python"
        self.upload(fixed)
        self.upload(moving)
        file = self.messages.InputFile
        return self.messages.RegistrationSpec(
            fixed=file(digest=digest_of(fixed), format="mha"), moving=file(digest=digest_of(moving), format="nii.gz"))

    def expect(self, code, reason, call, *arguments, **more):
        with self.assertRaises(grpc.RpcError) as caught:
            answer = call(*arguments, timeout=60, **more)
            if hasattr(answer, "__next__"):
                list(answer)
        self.assertEqual(caught.exception.code(), code, caught.exception.details())
        self.assertEqual(reason_of(caught.exception), reason)
        self.assertTrue(caught.exception.details())

    def test_health(self):
        check = self.channel.unary_unary("/grpc.health.v1.Health/Check")
        self.assertEqual(check(b"", timeout=60), b"\x08\x01")  # SERVING

    def test_server_info(self):
        info = self.info.GetServerInfo(self.messages.GetServerInfoRequest(), timeout=60)
        self.assertTrue(info.version)
        self.assertIn("sliding", info.models)
        self.assertIn("nii.gz", info.formats)
        self.assertGreater(info.max_message_bytes, 1 << 20)

    def test_upload_and_download(self):
        data = random.Random(7).randbytes(3_000_000)
        missing = self.messages.FindMissingBlobsRequest(digests=[digest_of(data)])
        self.assertEqual(list(self.blobs.FindMissingBlobs(missing, timeout=60).missing), [digest_of(data)])
        self.assertEqual(self.upload(data).size, len(data))
        self.assertEqual(list(self.blobs.FindMissingBlobs(missing, timeout=60).missing), [])
        self.assertEqual(self.upload(data).size, len(data), "the same again is no error")
        for offset in (0, 1, len(data) - 1, len(data)):
            request = self.messages.ReadBlobRequest(digest=digest_of(data), offset=offset)
            pieces = list(self.blobs.ReadBlob(request, timeout=60))
            self.assertEqual(b"".join(piece.data for piece in pieces), data[offset:])
            self.assertTrue(all(piece.size == len(data) for piece in pieces))

    def test_a_job_from_creation_to_deletion(self):
        request = self.messages.CreateRegistrationJobRequest(spec=self.spec(), request_id="python-1")
        job = self.jobs.CreateRegistrationJob(request, timeout=60)
        self.assertEqual(self.jobs.CreateRegistrationJob(request, timeout=60).id, job.id)
        watched = self.jobs.WatchRegistrationJob(self.messages.WatchRegistrationJobRequest(id=job.id), timeout=60)
        self.assertEqual(next(watched).job.id, job.id)
        self.jobs.CancelRegistrationJob(self.messages.CancelRegistrationJobRequest(id=job.id), timeout=60)
        last = None
        for event in watched:
            last = event.job.state
        final = self.jobs.GetRegistrationJob(self.messages.GetRegistrationJobRequest(id=job.id), timeout=60)
        self.assertIn(final.state, (self.messages.JOB_STATE_CANCELLED, self.messages.JOB_STATE_FAILED))
        self.assertIn(last, (None, final.state))
        listed = self.jobs.ListRegistrationJobs(self.messages.ListRegistrationJobsRequest(), timeout=60)
        self.assertIn(job.id, [entry.id for entry in listed.jobs])
        self.jobs.DeleteRegistrationJob(self.messages.DeleteRegistrationJobRequest(id=job.id), timeout=60)
        self.expect(grpc.StatusCode.NOT_FOUND, "JOB_NOT_FOUND", self.jobs.GetRegistrationJob,
                    self.messages.GetRegistrationJobRequest(id=job.id))

    def test_refusals(self):
        code = grpc.StatusCode
        create = self.messages.CreateRegistrationJobRequest
        self.expect(code.INVALID_ARGUMENT, "INVALID_FIELD", self.jobs.CreateRegistrationJob, create())
        spec = self.spec()
        self.jobs.CreateRegistrationJob(create(spec=spec, request_id="python-2"), timeout=60)
        other = create(spec=spec, request_id="python-2", labels={"a": "b"})
        self.expect(code.ALREADY_EXISTS, "REQUEST_ID_REUSED", self.jobs.CreateRegistrationJob, other)
        spec.fixed.digest = digest_of(b"never sent")
        self.expect(code.FAILED_PRECONDITION, "INPUT_MISSING", self.jobs.CreateRegistrationJob, create(spec=spec))
        self.expect(code.INVALID_ARGUMENT, "BAD_PAGE_TOKEN", self.jobs.ListRegistrationJobs,
                    self.messages.ListRegistrationJobsRequest(page_token="no token"))
        read = self.messages.ReadBlobRequest
        self.expect(code.NOT_FOUND, "BLOB_NOT_FOUND", self.blobs.ReadBlob, read(digest=digest_of(b"never sent")))
        self.upload(b"short")
        self.expect(code.OUT_OF_RANGE, "OFFSET_BEYOND_END", self.blobs.ReadBlob,
                    read(digest=digest_of(b"short"), offset=6))
        with self.assertRaises(grpc.RpcError) as caught:
            self.upload(b"what is sent", digest=digest_of(b"what is told"))
        self.assertEqual(caught.exception.code(), code.INVALID_ARGUMENT)
        self.assertEqual(reason_of(caught.exception), "DIGEST_MISMATCH")

    def test_bytes_that_are_no_message(self):
        """UNIMPLEMENTED is gRPC's own answer to what cannot be parsed; what happens to parse is refused by us."""
        chance = random.Random(1)
        noise = [b"", b"\xff", b"\x0a", b"\x0a\xff\xff\xff\xff\x0f", b"\x08" * 1000, b"\x0b" * 200]
        noise += [chance.randbytes(chance.randrange(1, 4000)) for _ in range(40)]
        allowed = {
            grpc.StatusCode.UNIMPLEMENTED, grpc.StatusCode.INVALID_ARGUMENT, grpc.StatusCode.NOT_FOUND,
            grpc.StatusCode.ABORTED, grpc.StatusCode.FAILED_PRECONDITION, grpc.StatusCode.OUT_OF_RANGE
        }
        harmless = {"GetServerInfo", "ListRegistrationJobs", "FindMissingBlobs", "TakeJob"}  # no job waits here
        count = 0
        for module in [stubs[name] for name in stubs if name.endswith("_pb2")]:
            for service in module.DESCRIPTOR.services_by_name.values():
                if service.name == "AdminService":
                    continue  # its empty request is a command
                for method in service.methods:
                    count += 1
                    for data in noise:
                        self.send_noise(f"/{service.full_name}/{method.name}", data, allowed,
                                        method.name in harmless)
        self.assertGreater(count, 12)
        self.assertIsNone(self.daemon.poll(), "the daemon has ended")
        self.test_server_info()

    def send_noise(self, path, data, allowed, is_harmless):
        # As a stream both ways: on the wire every other kind of call is a special case of it.
        call = self.channel.stream_stream(path)(iter([data]), timeout=60)
        try:
            list(call)
        except grpc.RpcError:
            pass
        code = call.code()
        if code == grpc.StatusCode.OK and is_harmless:
            return
        self.assertIn(code, allowed, f"{path} answered {code} {call.details()} to {data[:40]!r}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for name in ("daemon", "protoc", "plugin", "proto"):
        parser.add_argument("--" + name, required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as generated:
        stubs = make_stubs(generated)
        unittest.main(argv=[sys.argv[0], "-v"])
