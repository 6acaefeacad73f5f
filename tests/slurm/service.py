"""A daemon and its clients, for tests that bring workers of their own kind."""

import json
import os
import signal
import subprocess
import urllib.request

PATIENCE = 120
SHORT = ["--model", "gaussian", "--similarity", "ssd", "--set", "regularisation=0.0001"]
ENDLESS = ["--model", "sliding", "--set", "coarsening=0", "--set", "tolerance=0", "--set", "optimality_tolerance=0"]
# In many rounds: one may end as soon as nothing can be gained in single precision.
LONG = [*ENDLESS, "--set", "time_steps=64", "--set", "max_iterations=10000", "--set", "levels=1",
        "--set", "width_voxels=64", "--set", "map_steps=16", "--set", "reweighted_rounds=10",
        "--set", "sparsity_path=12"]
# Some seconds of work in several steps, with a checkpoint after each.
STEPS = [*ENDLESS, "--set", "time_steps=16", "--set", "max_iterations=30"]


class Service:
    """A daemon, and the command line as its client. `where` says on which host commands run, and waits."""

    def __init__(self, programs, folder, where, more=()):
        self.programs, self.folder, self.where, self.more = programs, folder, where, list(more)
        self.address = "unix:" + os.path.join(folder, "socket")
        self.daemon = None
        self.place = None  # where the daemon kills itself, see core/support/failpoint.h
        self.log = os.path.join(folder, "saltusd.log")

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def __enter__(self):
        self.run("phantom", "rectangle", "--size", "160,160", "--texture", "blobs", "--out", self.path("pair"))
        self.start()
        return self

    def __exit__(self, *_):
        self.kill()

    def start(self):
        program = os.path.join(self.programs, "saltusd")
        environment = dict(os.environ)
        if self.place:
            program = os.path.join(os.path.dirname(self.programs), "tests", "saltusd-failpoints")
            environment["SALTUS_FAILPOINT"] = self.place
            environment["SALTUS_FAILPOINT_ARMED"] = self.path("armed")
        self.daemon = subprocess.Popen(
            self.where.here(program, "--worker", os.path.join(self.programs, "saltus-worker"), "--data", self.path("data"), "--listen",
                            self.address, "--retry-seconds", "0.1", "--checkpoint-seconds", "0.1", "--lease-seconds",
                            "5", *self.more),
            stdout=subprocess.PIPE, stderr=open(self.log, "ab"), text=True, env=environment)
        line = self.daemon.stdout.readline()
        assert line.startswith("listening on"), f"{line}\n{self.told()}"
        self.protected = ""
        if "--tls-cert" in self.more:
            self.protected = self.daemon.stdout.readline().split()[2]
        if "--metrics" in self.more:
            self.metrics = self.daemon.stdout.readline().split()[2]

    def metric(self, name):
        with urllib.request.urlopen(self.metrics, timeout=PATIENCE) as answer:
            for line in answer.read().decode().splitlines():
                if line.split(" ")[0] == name:
                    return float(line.split(" ")[1])
        raise RuntimeError("no metric " + name)

    def kill(self, how=signal.SIGKILL):
        if self.daemon is None:
            return None
        self.daemon.send_signal(how)
        code = self.daemon.wait(PATIENCE)
        self.daemon.stdout.close()
        self.daemon = None
        return code

    def arm(self):
        """From now on the daemon kills itself when it comes to the place."""
        with open(self.path("armed"), "wb"):
            pass

    def wait_for_death(self):
        equal(self.daemon.wait(PATIENCE), -signal.SIGKILL, f"end at {self.place}")
        self.daemon.stdout.close()
        self.daemon, self.place = None, None
        os.remove(self.path("armed"))

    def run(self, *words, check=True):
        done = subprocess.run([os.path.join(self.programs, "saltus"), *words], capture_output=True, text=True,
                              timeout=PATIENCE, check=False)
        if check and done.returncode != 0:
            raise RuntimeError(f"saltus {' '.join(words)}: {done.returncode} {done.stderr}")
        return done.stdout

    def refusal(self, *more):
        """What the daemon says to a job that it does not take."""
        try:
            return f"{self.submit(*SHORT, *more)} was taken"
        except RuntimeError as error:
            return str(error)

    def submit(self, *more):
        pair = []
        for role in ("fixed", "moving"):
            found = [name for name in os.listdir(self.path("pair")) if name.startswith(role + ".")]
            assert len(found) == 1, os.listdir(self.path("pair"))
            pair += ["--" + role, self.path("pair", found[0])]
        threads = [] if "--threads" in more else ["--threads", "1"]
        out = self.run("submit", *pair, "--preset", "fast", "--format", "mha", "--server", self.address, *threads,
                       *more)
        return out.split()[0]

    def get(self, job):
        return json.loads(self.run("get", job, "--json", "--server", self.address))

    def wait(self, job, condition, what):
        found = {}

        def is_so():
            found.update(self.get(job))
            return condition(found)

        try:
            self.where.wait_until(is_so, f"{what}, of {job}")
        except RuntimeError as error:
            raise RuntimeError(f"{error}\n{json.dumps(found, indent=1)}\n{self.told()}") from error
        return dict(self.get(job))

    def wait_for_state(self, job, state):
        ended = ("SUCCEEDED", "FAILED", "CANCELLED")
        found = self.wait(job, lambda j: j["state"] == state or j["state"] in ended, state)
        assert found["state"] == state, f"{json.dumps(found, indent=1)}\n{self.told()}"
        return found

    def wait_for_work(self, job, attempt=1):
        return self.wait(job, lambda j: j["attempt"] >= attempt and
                         j.get("progress", {}).get("stage") == "optimising" and j["progress"]["iteration"] > 0,
                         f"attempt {attempt} at work")

    def told(self):
        with open(self.log, encoding="utf-8", errors="replace") as log:
            return log.read()


def equal(found, expected, what=""):
    assert found == expected, f"{what}: {found!r} is not {expected!r}"


def results(job):
    """Digests of what the solver has found; the other files have times in them."""
    return {a["name"]: a["digest"] for a in job["artifacts"] if a["name"].endswith(".mha")}


def pair(service, role):
    found = [name for name in os.listdir(service.path("pair")) if name.startswith(role + ".")]
    return service.path("pair", found[0])


def workers_of(job):
    """The processes that do the work of this job: not their guards."""
    found = []
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                with open(f"/proc/{name}/cmdline", "rb") as line:
                    words = line.read().split(b"\0")
            except OSError:
                continue  # it has ended
            if job.encode() in words and b"--guard" not in words and b"saltus-worker" in words[0]:
                found.append(int(name))
    return found


def worker_of(job):
    found = workers_of(job)
    equal(len(found), 1, "workers of " + job)
    return found[0]


def worker_is_killed(service):
    """The process that does the work is killed: that is known at once, and the next attempt goes on from the checkpoint
    to the same bits."""
    undisturbed = service.wait_for_state(service.submit(*STEPS), "SUCCEEDED")
    job = service.submit(*STEPS)
    service.wait(job, lambda j: "checkpoint" in j, "a checkpoint")
    os.kill(worker_of(job), signal.SIGKILL)
    lost = service.wait(job, lambda j: "last_loss" in j, "the loss to be known")
    equal(lost["last_loss"]["reason"], "WORKER_CRASHED")
    done = service.wait_for_state(job, "SUCCEEDED")
    equal(done["attempt"], 2)
    equal(results(done), results(undisturbed), "the bits of a run that was killed")


def tls_options(folder, address):
    """Makes an authority, a certificate for the daemon and one for workers; the options that name them."""
    def path(name):
        return os.path.join(folder, name)

    def openssl(*words):
        subprocess.run(["openssl", *words], check=True, capture_output=True)

    openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2", "-subj",
            "/CN=authority", "-keyout", path("ca.key"), "-out", path("ca.pem"))
    for name, more in (("daemon", f"subjectAltName=IP:{address}"), ("worker", "subjectAltName=DNS:node.test")):
        openssl("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj", "/CN=" + name,
                "-keyout", path(name + ".key"), "-out", path(name + ".csr"))
        with open(path(name + ".ext"), "w", encoding="ascii") as extension:
            extension.write(more + "\n")
        openssl("x509", "-req", "-in", path(name + ".csr"), "-CA", path("ca.pem"), "-CAkey", path("ca.key"),
                "-CAcreateserial", "-days", "2", "-extfile", path(name + ".ext"), "-out", path(name + ".pem"))
    with open(path("roles"), "w", encoding="ascii") as roles:
        roles.write("node.test = worker\n")
    return ["--listen", address + ":0", "--tls-cert", path("daemon.pem"), "--tls-key", path("daemon.key"),
            "--tls-client-ca", path("ca.pem"), "--roles", path("roles")]


def worker_tls(folder, prefix=""):
    """The options that name those of workers; `prefix` as in --slurm-tls-ca."""
    names = (("ca", "ca.pem"), ("cert", "worker.pem"), ("key", "worker.key"))
    return [word for what, name in names for word in (f"--{prefix}tls-{what}", os.path.join(folder, name))]
