"""Installs into an empty folder, builds the examples against it as a stranger would, and runs them with a daemon."""

import argparse
import json
import os
import subprocess
import sys
import tempfile

parser = argparse.ArgumentParser()
for name in ("cmake", "build", "source", "protoc", "plugin"):
    parser.add_argument("--" + name, required=True)
options = parser.parse_args()


def run(*command, **more):
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **more)
    if done.returncode != 0:
        sys.exit(f"{command} ended with {done.returncode}:\n{done.stdout}")
    return done.stdout


with tempfile.TemporaryDirectory() as folder:
    prefix, there = os.path.join(folder, "prefix"), os.path.join(folder, "examples")
    run(options.cmake, "--install", options.build, "--prefix", prefix)
    for file in ("bin/saltus", "bin/saltusd", "bin/saltus-worker", "share/man/man1/saltus.1",
                 "share/bash-completion/completions/saltus", "share/zsh/site-functions/_saltus",
                 "share/fish/vendor_completions.d/saltus.fish", "share/saltus/proto/saltus/v1/registration.proto"):
        assert os.path.getsize(os.path.join(prefix, file)) > 0, file
    # The examples are copied away, so that nothing of the source tree is found by chance.
    run("cp", "-r", os.path.join(options.source, "client/examples"), there)
    run(options.cmake, "-S", there, "-B", there, "-DCMAKE_PREFIX_PATH=" + prefix, "-DCMAKE_BUILD_TYPE=Release")
    run(options.cmake, "--build", there)
    told = run(os.path.join(there, "register_in_process"))
    assert "error 0." in told, told

    saltus = os.path.join(prefix, "bin/saltus")
    volumes, result = os.path.join(folder, "volumes"), os.path.join(folder, "from_files")
    run(saltus, "phantom", "smooth", "--size", "40,40,32", "--displacement", "3", "--out", volumes)
    told = run(os.path.join(there, "register_files"), os.path.join(volumes, "fixed.mha"),
               os.path.join(volumes, "moving.mha"), result)
    before, after = (float(number) for number in told.split(",")[0].removeprefix("dissimilarity ").split(" -> "))
    assert after < 0.7 * before, told
    scored = json.loads(run(saltus, "evaluate", "--transform", os.path.join(result, "displacement.nii.gz"), "--truth",
                            os.path.join(volumes, "truth.mha"), "--json"))
    assert scored["epe_mm"]["mean"] < 0.7 * scored["epe_before_mm"]["mean"], scored
    run(saltus, "phantom", "slip", "--size", "48,48", "--out", os.path.join(folder, "pair"))
    daemon = subprocess.Popen(
        [os.path.join(prefix, "bin/saltusd"), "--data", os.path.join(folder, "data"), "--log-level", "error"],
        stdout=subprocess.PIPE, text=True)
    try:
        address = daemon.stdout.readline().strip().removeprefix("listening on ")
        told = run(os.path.join(there, "register_by_service"), address, os.path.join(folder, "pair/fixed.mha"),
                   os.path.join(folder, "pair/moving.mha"), os.path.join(folder, "result"))
        assert os.path.exists(os.path.join(folder, "result/report.html")), told
        try:
            import google.protobuf
            import grpc
            import numpy
        except ImportError as error:
            print(f"the Python example was left out: {error}")
        else:
            run(options.protoc, "-I", os.path.join(prefix, "share/saltus/proto"), "--python_out=" + there,
                "--grpc_out=" + there, "--plugin=protoc-gen-grpc=" + options.plugin, "saltus/v1/registration.proto")
            told = run(sys.executable, os.path.join(there, "register.py"), address)
            x, y = (float(n) for n in told.split("[")[1].split("]")[0].split())
            assert abs(x - 3) < 0.6 and abs(y) < 0.6, told
    finally:
        daemon.terminate()
        daemon.wait(60)
