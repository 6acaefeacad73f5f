"""The numerics compile for processors with other registers than this one's: those of the packages and those of any. Looked at
are the sources that see core/support/registers.h, whose templates are other ones there; nothing is linked or run.
Usage: instruction_sets_test.py SOURCE COMPILER OPTION..."""

import concurrent.futures
import os
import re
import subprocess
import sys

source, compiler, *options = sys.argv[1:]
SETS = ("x86-64-v4", "x86-64-v3", "x86-64")
REGISTERS = "core/support/registers.h"
included = {}


def includes(path):
    """What a file of the core includes, and what that does."""
    if path not in included:
        included[path] = set()
        with open(os.path.join(source, path), encoding="utf-8") as file:
            direct = re.findall(r'^#include "(core/[^"]+)"', file.read(), re.MULTILINE)
        included[path] = set(direct).union(*(includes(other) for other in direct))
    return included[path]


def compiled(what):
    path, instructions = what
    done = subprocess.run([compiler, "-fsyntax-only", f"-march={instructions}", *options, "-I", source,
                           os.path.join(source, path)], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, check=False)
    return f"{path} with -march={instructions}:\n{done.stdout}" if done.returncode else ""


known = subprocess.run([compiler, "-fsyntax-only", f"-march={SETS[0]}", "-x", "c++", os.devnull], check=False,
                       stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
if known.returncode:
    print("SKIPPED: this compiler is for other processors: " + known.stdout.splitlines()[0])
    sys.exit()
sources = [os.path.relpath(os.path.join(folder, name), source)
           for folder, _, names in os.walk(os.path.join(source, "core")) for name in names if name.endswith(".cpp")]
concerned = sorted(path for path in sources if REGISTERS in includes(path))
assert len(concerned) > 5, f"only {concerned} include {REGISTERS}"
with concurrent.futures.ThreadPoolExecutor(2) as pool:
    failed = [text for text in pool.map(compiled, [(path, one) for path in concerned for one in SETS]) if text]
assert not failed, "\n".join(failed)
print(f"{len(concerned)} sources compile for {' and '.join(SETS)}")
