"""What kustomize makes of deploy/kubernetes: one daemon with a volume, workers, probes, and rules of who may talk to whom; and
the programs know the options and the configuration that are used there."""

import os
import re
import shutil
import subprocess
import tempfile

from service import arguments, run, skip

try:
    import yaml
except ImportError as error:
    skip(f"{error}; install python3-yaml")

options = arguments()
folder = os.path.join(options.source, "deploy/kubernetes")
kustomize = ["kustomize", "build"] if shutil.which("kustomize") else ["kubectl", "kustomize"]
if not shutil.which(kustomize[0]):
    skip("neither kustomize nor kubectl is installed")


def rendered(name):
    done = subprocess.run([*kustomize, os.path.join(folder, name)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          text=True, check=False)
    assert done.returncode == 0 and "deprecated" not in done.stderr, done.stderr
    return list(yaml.safe_load_all(done.stdout))


def one(objects, kind, name):
    # What is generated from files has a digest of them at the end of its name.
    found = [item for item in objects
             if item["kind"] == kind and re.fullmatch(name + "(-[a-z0-9]{10})?", item["metadata"]["name"])]
    assert len(found) == 1, (kind, name, [item["metadata"]["name"] for item in objects])
    return found[0]


def selects(selector, labels):
    return all(labels.get(key) == value for key, value in selector.items())


def check_container(pod, name):
    (container,) = pod["containers"]
    assert container["name"] == name
    assert pod["securityContext"]["runAsNonRoot"] and pod["automountServiceAccountToken"] is False
    assert pod["securityContext"]["seccompProfile"]["type"] == "RuntimeDefault"
    security = container["securityContext"]
    assert security["readOnlyRootFilesystem"] and security["allowPrivilegeEscalation"] is False
    assert security["capabilities"]["drop"] == ["ALL"]
    assert container["resources"]["limits"]["memory"] and container["resources"]["requests"]["cpu"]
    volumes = {volume["name"] for volume in pod["volumes"]}
    return container, volumes


def known_options(program, words):
    help_text = run(os.path.join(options.programs, program), "--help")
    for word in words:
        if word.startswith("--") and word != "--":
            assert word in help_text, f"{program} has no {word}"


def check(objects):
    kinds = sorted(item["kind"] for item in objects)
    assert kinds == ["ConfigMap", "Deployment", "NetworkPolicy", "NetworkPolicy", "NetworkPolicy", "PodDisruptionBudget",
                     "Service", "StatefulSet"], kinds

    daemon = one(objects, "StatefulSet", "saltusd")["spec"]
    assert daemon["replicas"] == 1, "the queue has one writer"
    pod = daemon["template"]["spec"]
    container, volumes = check_container(pod, "saltusd")
    (claim,) = daemon["volumeClaimTemplates"]
    assert claim["spec"]["accessModes"] == ["ReadWriteOnce"]
    mounts = {mount["mountPath"]: mount for mount in container["volumeMounts"]}
    assert mounts["/var/lib/saltus"]["name"] == claim["metadata"]["name"]
    assert {mount["name"] for mount in mounts.values()} <= volumes | {claim["metadata"]["name"]}
    assert pod["terminationGracePeriodSeconds"] > 60
    for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
        command = container[probe]["exec"]["command"]
        assert command[:3] == ["saltus", "server", "info"] and container[probe]["timeoutSeconds"] >= 10, probe

    # The configuration that is mounted is one that the daemon takes, and its files are where the pod has them.
    configuration = one(objects, "ConfigMap", "saltus")
    assert {volume["configMap"]["name"] for volume in pod["volumes"] if "configMap" in volume} == {
        configuration["metadata"]["name"]}
    with tempfile.TemporaryDirectory() as there:
        path = os.path.join(there, "saltusd.conf")
        with open(path, "w", encoding="utf-8") as file:
            file.write(configuration["data"]["saltusd.conf"])
        printed = run(os.path.join(options.programs, "saltusd"), "--config", path, "--print-config")
    said = dict(re.findall(r"^([a-z-]+) = (.*)$", printed, re.MULTILINE))
    for name in ("data", "tls-cert", "tls-key", "tls-client-ca", "roles"):
        assert any(said[name].startswith(mount) for mount in mounts), name
    assert "unix:" + container["livenessProbe"]["exec"]["command"][-1].removeprefix("unix:") in printed
    assert said["slots"] == "0", "workers are pods of their own"

    worker = one(objects, "Deployment", "saltus-worker")["spec"]
    container, _ = check_container(worker["template"]["spec"], "saltus-worker")
    assert container["command"][:3] == ["tini", "--", "saltus-worker"]
    known_options("saltus-worker", container["command"][3:])
    used = dict(zip(container["command"][3::2], container["command"][4::2]))
    assert float(used["--memory"]) < int(container["resources"]["limits"]["memory"].removesuffix("Gi")), used
    assert used["--threads"] == container["resources"]["requests"]["cpu"], used
    service = one(objects, "Service", "saltusd")["spec"]
    (port,) = service["ports"]
    assert f"saltusd:{port['port']}" in container["command"] and f"0.0.0.0:{port['port']}" in printed
    labels = {part: spec["template"]["metadata"]["labels"] for part, spec in (("daemon", daemon), ("worker", worker))}
    assert selects(service["selector"], labels["daemon"]) and not selects(service["selector"], labels["worker"])
    budget = one(objects, "PodDisruptionBudget", "saltus-worker")["spec"]
    assert selects(budget["selector"]["matchLabels"], labels["worker"])

    # Nobody may do anything, except what is said.
    nobody = one(objects, "NetworkPolicy", "saltus-nobody")["spec"]
    assert sorted(nobody["policyTypes"]) == ["Egress", "Ingress"] and "ingress" not in nobody and "egress" not in nobody
    assert selects(nobody["podSelector"].get("matchLabels", {}), labels["daemon"])
    assert selects(nobody["podSelector"].get("matchLabels", {}), labels["worker"])
    into = one(objects, "NetworkPolicy", "saltusd")["spec"]
    assert selects(into["podSelector"]["matchLabels"], labels["daemon"])
    assert not selects(into["podSelector"]["matchLabels"], labels["worker"])
    (rule,) = into["ingress"]
    assert [item["port"] for item in rule["ports"]] == [port["port"]]
    assert any(selects(peer["podSelector"]["matchLabels"], labels["worker"])
               for peer in rule["from"] if "podSelector" in peer)
    out = one(objects, "NetworkPolicy", "saltus-worker")["spec"]
    assert selects(out["podSelector"]["matchLabels"], labels["worker"])
    assert any(selects(peer["podSelector"]["matchLabels"], labels["daemon"])
               for rule in out["egress"] for peer in rule.get("to", []))
    return worker["replicas"], container["image"], objects[0]["metadata"].get("namespace")


assert check(rendered("base")) == (2, "saltus", None)
assert check(rendered("example")) == (16, "registry.hospital.example/saltus:0.1.0", "saltus")
