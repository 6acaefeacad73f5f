"""The systemd unit: what systemd-analyze says of it, what the daemon needs of it, and the configuration beside it."""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile

parser = argparse.ArgumentParser()
for name in ("source", "daemon"):
    parser.add_argument("--" + name, required=True)
options = parser.parse_args()
folder = os.path.join(options.source, "deploy/systemd")

if not shutil.which("systemd-analyze"):
    print("SKIPPED: systemd-analyze is not installed")
    sys.exit()


def run(*command):
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return done.returncode, done.stdout


with open(os.path.join(folder, "saltusd.service"), encoding="utf-8") as file:
    unit = file.read()

with tempfile.TemporaryDirectory() as there:
    # verify looks for the program, which is not installed here.
    copy = os.path.join(there, "saltusd.service")
    with open(copy, "w", encoding="utf-8") as file:
        file.write(unit.replace("/usr/bin/saltusd", options.daemon))
    code, told = run("systemd-analyze", "verify", "--man=no", copy)
    assert code == 0 and not told.strip(), told
    with open(copy, "a", encoding="utf-8") as file:
        file.write("[Service]\nWatchDog=1\n")
    code, told = run("systemd-analyze", "verify", "--man=no", copy)
    assert "WatchDog" in told, f"a mistake is not noticed: {told}"

    # 19 is an exposure of 1.9.
    code, told = run("systemd-analyze", "security", "--offline=true", "--no-pager", "--threshold=19",
                     os.path.join(folder, "saltusd.service"))
    print(told.strip().splitlines()[-1])
    assert code == 0, told

for needed in ("Type=notify", "WatchdogSec=", "OOMPolicy=continue", "KillMode=mixed", "LoadCredential=",
               "User=saltus", "StateDirectory=saltus", "TimeoutStopSec="):
    assert f"\n{needed}" in unit, needed

# The file as it is installed, and once more with everything said that it only shows.
with open(os.path.join(folder, "saltusd.conf"), encoding="utf-8") as file:
    text = file.read()
shown = "\n".join(line[1:] if line.startswith("#") and line[1:2] != " " else line for line in text.splitlines())
assert shown != text
with tempfile.TemporaryDirectory() as there:
    for content, said in ((text, "\ndata = /var/lib/saltus\n"), (shown, "\nlisten = 0.0.0.0:50051\n")):
        path = os.path.join(there, "saltusd.conf")
        with open(path, "w", encoding="utf-8") as file:
            file.write(content)
        code, told = run(options.daemon, "--config", path, "--print-config")
        assert code == 0 and said in told, told
