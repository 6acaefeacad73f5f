"""Workers that come by themselves, with mutual TLS: standing_worker_test.py --programs build/bin --case NAME."""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from service import (LONG, PATIENCE, SHORT, Service, equal, tls_options, worker_is_killed, worker_tls,  # noqa: E402
                     workers_of)

parser = argparse.ArgumentParser()
parser.add_argument("--programs", required=True)
parser.add_argument("--case", required=True)
options = parser.parse_args()


class Here:
    """This machine, and nothing else."""

    @staticmethod
    def here(*words):
        return list(words)

    @staticmethod
    def wait_until(condition, what):
        until = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > until:
                raise RuntimeError(f"waited {PATIENCE} s for {what} in vain")
            time.sleep(0.05)


class Workers:
    """Standing workers of the test, each with a folder for its temporary files."""

    def __init__(self, service, folder):
        self.service, self.folder, self.started = service, folder, []

    def start(self, *more, address=None, **environment):
        temporary = os.path.join(self.folder, f"tmp{len(self.started)}")
        os.makedirs(temporary)
        log = open(os.path.join(self.folder, f"worker{len(self.started)}.log"), "wb")
        self.started.append(subprocess.Popen(
            [os.path.join(options.programs, "saltus-worker"), "--server", address or self.service.protected,
             *worker_tls(self.folder), *([] if "--threads" in more else ["--threads", "1"]), *more], stdout=log, stderr=log,
            env=dict(os.environ, TMPDIR=temporary, **environment)))
        return self.started[-1]

    def told(self):
        text = ""
        for number in range(len(self.started)):
            with open(os.path.join(self.folder, f"worker{number}.log"), encoding="utf-8", errors="replace") as log:
                text += f"\nworker {number}:\n" + log.read()
        return text

    def end(self):
        for worker in self.started:
            if worker.poll() is None:
                worker.kill()
            worker.wait()


def many_jobs(service, workers):
    """Several workers share a queue, none does a job twice, each ends when it is idle, and leaves nothing."""
    jobs = [service.submit(*SHORT) for _ in range(6)]
    standing = [workers.start("--idle-seconds", "2") for _ in range(2)]
    for job in jobs:
        equal(service.wait_for_state(job, "SUCCEEDED")["attempt"], 1)
    for worker in standing:
        equal(worker.wait(PATIENCE), 0, workers.told())
    for number in range(2):
        equal(os.listdir(os.path.join(workers.folder, f"tmp{number}")), [], "temporary files")


def killed_work(service, workers):
    """The process of an attempt is killed: the daemon hears of it at once, and the worker takes the next."""
    worker = workers.start()
    worker_is_killed(service)
    equal(worker.poll(), None, workers.told())


def threads_of_attempts(service, workers):
    """What the daemon says of threads to workers that it launches, a standing worker says to its attempts; and OpenMP's
    library, which binds the worker's first thread to one core, does not bind theirs."""
    workers.start(OMP_PROC_BIND="true", OMP_WAIT_POLICY="active")
    job = service.submit(*LONG)
    service.wait_for_work(job)
    attempt, = workers_of(job)
    with open(f"/proc/{attempt}/environ", encoding="utf-8") as file:
        variables = dict(one.split("=", 1) for one in file.read().split("\0") if one)
    for name, value in (("OMP_NUM_THREADS", "1"), ("OMP_WAIT_POLICY", "PASSIVE"), ("OMP_PROC_BIND", "false")):
        equal(variables[name], value, name)
    equal(os.sched_getaffinity(attempt), os.sched_getaffinity(0), "cores")
    service.run("cancel", job, "--server", service.address)
    service.wait_for_state(job, "CANCELLED")


def orderly_end(service, workers):
    """SIGTERM hands the job back; another worker goes on with it."""
    worker = workers.start()
    job = service.submit(*LONG)
    service.wait(job, lambda j: "checkpoint" in j, "a checkpoint")
    worker.send_signal(signal.SIGTERM)
    equal(worker.wait(PATIENCE), 0, workers.told())
    equal(workers_of(job), [], "workers of the job")
    workers.start()
    found = service.wait(job, lambda j: j["attempt"] == 2 and j.get("progress", {}).get("is_resumed"), "to go on")
    equal(found["last_loss"]["reason"], "WORKER_EXITED")
    service.run("cancel", job, "--server", service.address)
    service.wait_for_state(job, "CANCELLED")


def daemon_restart(service, workers):
    """kill -9 of the daemon: work goes on, and workers that wait come back by themselves."""
    workers.start()
    running = service.submit(*LONG)
    service.wait_for_work(running)
    address = service.protected
    service.more[service.more.index(address.rsplit(":", 1)[0] + ":0")] = address
    workers.start()
    service.kill()
    service.start()
    found = service.wait_for_work(running)
    iteration = found["progress"]["iteration"]
    service.wait(running, lambda j: j["progress"]["iteration"] > iteration, "to get on")
    equal(service.get(running)["attempt"], 1)
    equal(service.wait_for_state(service.submit(*SHORT), "SUCCEEDED")["attempt"], 1)
    service.run("cancel", running, "--server", service.address)
    service.wait_for_state(running, "CANCELLED")
    equal(workers_of(running), [], "workers of the job")


def killed_at_taking(service, workers):
    """kill -9 when a job has been given away and before its worker knows: a next attempt does it."""
    service.kill()
    service.place = "commit.after"
    service.start()
    address = service.protected
    service.more[service.more.index(address.rsplit(":", 1)[0] + ":0")] = address
    job = service.submit(*SHORT)
    # Nothing is written any more until the job is given to somebody.
    service.arm()
    workers.start()
    service.wait_for_death()
    service.start()
    lost = service.wait(job, lambda j: "last_loss" in j, "the loss to be known")
    equal(lost["last_loss"]["reason"], "LEASE_EXPIRED")
    equal(service.wait_for_state(job, "SUCCEEDED")["attempt"], 2)


def strangers(service, workers):
    """Without the role worker, a certificate, or TLS at all, nobody gets a job; and nobody who offers too little."""
    job = service.submit(*SHORT, "--threads", "2")
    with open(os.path.join(workers.folder, "roles"), "w", encoding="ascii") as roles:
        roles.write("node.test = submitter\n")
    service.where.wait_until(lambda: "roles were read again" in service.told(), "the roles to be read")
    refused = workers.start("--threads", "2")
    equal(refused.wait(PATIENCE), 1)
    assert "(submitter) may not call /saltus.v1.WorkerService/TakeJob" in workers.told(), workers.told()
    plain = subprocess.run([os.path.join(options.programs, "saltus-worker"), "--server", "node.example:1"],
                           capture_output=True, text=True, timeout=PATIENCE, check=False)
    equal(plain.returncode, 2)
    assert "must not cross a network in the clear" in plain.stderr, plain.stderr
    with open(os.path.join(workers.folder, "roles"), "w", encoding="ascii") as roles:
        roles.write("node.test = worker\n# again\n")
    service.where.wait_until(lambda: service.told().count("roles were read again") == 2, "the roles to be read")
    small = workers.start("--idle-seconds", "1")
    equal(small.wait(PATIENCE), 0)
    equal(service.get(job)["state"], "QUEUED")
    large = workers.start("--threads", "2", "--idle-seconds", "1")
    equal(service.wait_for_state(job, "SUCCEEDED")["attempt"], 1)
    equal(large.wait(PATIENCE), 0)


CASES = {case.__name__: case for case in (many_jobs, killed_work, threads_of_attempts, orderly_end, daemon_restart,
                                              killed_at_taking, strangers)}


def main():
    with tempfile.TemporaryDirectory(prefix="saltus-workers-") as folder:
        more = ["--slots", "0", "--threads-per-job", "1"] + tls_options(folder, "127.0.0.1")
        with Service(options.programs, folder, Here(), more) as service:
            workers = Workers(service, folder)
            try:
                CASES[options.case](service, workers)
            except BaseException:
                print(service.told(), workers.told(), sep="\n")
                raise
            finally:
                workers.end()
    return 0


sys.exit(main())
