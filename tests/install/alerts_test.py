"""Every number that an alert looks at is one that the daemon serves, with the labels that the alert names; and the runbook
says of every alert what to do."""

import os
import re
import shutil
import tempfile
import urllib.request

from service import Daemon, arguments, run, skip

try:
    import yaml
except ImportError as error:
    skip(f"{error}; install python3-yaml")

options = arguments()
saltus = os.path.join(options.programs, "saltus")
rules_file = os.path.join(options.source, "deploy/prometheus/alerts.yml")
CODES = {"UNAVAILABLE", "DATA_LOSS", "INTERNAL", "PERMISSION_DENIED", "UNAUTHENTICATED"}

with open(rules_file, encoding="utf-8") as file:
    rules = [rule for group in yaml.safe_load(file)["groups"] for rule in group["rules"]]
with open(os.path.join(options.source, "deploy/README.md"), encoding="utf-8") as file:
    runbook = file.read()
with open(os.path.join(options.source, "server/rpc/call_interceptor.cpp"), encoding="utf-8") as file:
    codes = CODES & set(re.findall(r'"([A-Z_]+)"', file.read()))
assert codes == CODES, codes

with tempfile.TemporaryDirectory() as folder:
    pair = os.path.join(folder, "pair")
    run(saltus, "phantom", "slip", "--size", "40,40", "--out", pair)
    with Daemon(options, os.path.join(folder, "data"), "--metrics", "127.0.0.1:0") as daemon:
        metrics = daemon.next_address()
        job = ("--server", daemon.address, "--moving", pair + "/moving.mha", "--similarity", "ssd", "--preset", "fast")
        run(saltus, "register", *job, "--fixed", pair + "/fixed.mha", "--out", os.path.join(folder, "result"))
        with urllib.request.urlopen(metrics) as answer:
            served = answer.read().decode()

values = {}
for line in served.splitlines():
    if not line.startswith("#"):
        name, labels = re.match(r"([a-z_]+)(?:\{(.*?)\})? ", line).groups()
        values.setdefault(name, set()).update(re.findall(r'(\w+)="([^"]*)"', labels or ""))

names = 0
for rule in rules:
    assert set(rule) >= {"alert", "expr", "labels", "annotations"} and rule["labels"]["severity"], rule
    assert f"| `{rule['alert']}` |" in runbook, f"deploy/README.md does not say what to do about {rule['alert']}"
    for name, labels in re.findall(r"\b((?:saltusd|process)_[a-z_]+)(?:\{(.*?)\})?", rule["expr"]):
        assert name in values, f"{rule['alert']} looks at {name}, which the daemon does not serve:\n{served}"
        for label, wanted in re.findall(r'(\w+)=~?"([^"]*)"', labels):
            known = {value for key, value in values[name] if key == label}
            # What has not happened has no line yet; what it would be called is known.
            known |= {"code": CODES, "outcome": {"lost", "failed"}, "job": {"saltus"}}.get(label, set())
            assert set(wanted.split("|")) <= known, f"{rule['alert']}: {name} has no {label}={wanted}, but {known}"
        names += 1
assert names >= len(rules), names
for alert in re.findall(r"^\| `(Saltus\w+)` \|", runbook, re.MULTILINE):
    assert alert in {rule["alert"] for rule in rules}, f"deploy/README.md tells of {alert}, which is no alert"
if shutil.which("promtool"):
    run("promtool", "check", "rules", rules_file)
