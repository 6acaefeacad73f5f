"""What the tests of deploy/README.md share: programs, and a daemon that is a child of the test."""

import argparse
import os
import signal
import subprocess
import sys


def arguments():
    """--source: the repository; --programs: the folder with saltus and saltusd."""
    parser = argparse.ArgumentParser()
    for name in ("source", "programs"):
        parser.add_argument("--" + name, required=True)
    return parser.parse_args()


def skip(reason):
    print(f"SKIPPED: {reason}")
    sys.exit()


def run(*command, code=0):
    """What the program printed, both streams; fails with it when the exit code is another than `code` (None: any)."""
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if code is not None and done.returncode != code:
        raise AssertionError(f"{command} ended with {done.returncode}:\n{done.stdout}")
    return done.stdout


class Daemon:
    """A saltusd with its data in `data`. At the end of a with block it is stopped, and has to end in order."""

    def __init__(self, options, data, *more):
        self.addresses = {}
        self._process = subprocess.Popen(
            [os.path.join(options.programs, "saltusd"), "--data", data, "--log-level", "warning", "--disk-reserve", "0",
             "--retry-seconds", "0", *more],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.address = self._read("listening on ")

    def _read(self, said):
        line = self._process.stdout.readline()
        if said not in line:
            self._process.kill()
            raise AssertionError(f"saltusd said '{line}' and {self._process.communicate()[1]}")
        return line.split(said)[1].strip()

    def next_address(self):
        """The next one that it prints: of mutual TLS first, then of the metrics."""
        line = self._process.stdout.readline()
        return line.split(" on ")[1].split(" with ")[0].strip()

    def crash(self):
        self._process.send_signal(signal.SIGKILL)
        self._process.communicate()

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        if self._process.returncode is None:
            self._process.terminate()
            said = self._process.communicate(timeout=120)[1]
            assert kind or self._process.returncode == 0, said
