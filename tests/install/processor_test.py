"""On a processor without what the numerics were compiled for, each program says so in one sentence; on others it works."""

import os
import shutil
import subprocess
import sys

from service import arguments, skip

options = arguments()
qemu = shutil.which("qemu-x86_64")
if not qemu:
    skip("no emulator of older processors here (Debian: qemu-user)")
# What the numerics were compiled for is what this build knows of itself.
with open(os.path.join(os.path.dirname(options.programs), "CMakeCache.txt"), encoding="utf-8") as cache:
    if "SALTUS_USES_AVX2:INTERNAL=1\n" not in cache.read():
        skip("this build needs no AVX2")

for program in ("saltus", "saltusd", "saltus-worker"):
    path = os.path.join(options.programs, program)
    old = subprocess.run([qemu, "-cpu", "Nehalem", path, "--version"], capture_output=True, text=True, check=False)
    assert old.returncode == 1, f"{program} ends with {old.returncode}: {old.stderr}"
    assert old.stderr.startswith("This processor has no AVX2") and old.stderr.count("\n") == 1, old.stderr
    assert subprocess.run([path, "--help"], stdout=subprocess.DEVNULL, check=False).returncode == 0
sys.exit()
