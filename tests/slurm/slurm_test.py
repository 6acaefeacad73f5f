"""The daemon with a real Slurm of one machine: what the launcher promises must hold when Slurm does what it does.

Each case is a test of its own: slurm_test.py --programs build/bin --case NAME.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import cluster  # noqa: E402
from service import (LONG, SHORT, STEPS, Service, equal, pair, tls_options, worker_is_killed, worker_of,  # noqa: E402
                     worker_tls, workers_of)

parser = argparse.ArgumentParser()
parser.add_argument("--programs", required=True)
parser.add_argument("--case", required=True)
options = parser.parse_args()

def names_of_live(slurm):
    return [name for _, name, state in slurm.jobs() if state in ("PENDING", "RUNNING", "COMPLETING")]


def normal_run(service, slurm):
    """Declared resources reach Slurm, the result comes back, and nothing is left on the node."""
    before = set(os.listdir(tempfile.gettempdir()))
    job = service.submit(*SHORT, "--memory", "0.1953125", "--wall-time", "10", "--threads", "2")
    done = service.wait_for_state(job, "SUCCEEDED")
    equal(done["attempt"], 1)
    number = done["batch_id"]
    assert number.isdigit() and "begin_time" in done, done
    told = slurm.run("scontrol", "show", "job", number)
    for text in ("NumCPUs=2", "MinMemoryNode=200M", "TimeLimit=00:12:00", "Requeue=0", f"saltus-"):
        assert text in told, f"{text} is not in {told}"
    slurm.wait_until(lambda: not names_of_live(slurm), "Slurm's queue to be empty")
    assert "COMPLETED" in {state for _, _, state in slurm.jobs()}
    left = {name for name in set(os.listdir(tempfile.gettempdir())) - before if name.startswith("saltus-worker")}
    equal(left, set(), "temporary files on the node")
    # The same bits as without Slurm.
    out = service.path("here")
    service.run("register", "--fixed", pair(service, "fixed"), "--moving", pair(service, "moving"), "--preset", "fast",
                "--threads", "2", "--format", "mha", "--out", out, *SHORT)
    service.run("fetch", job, "--out", service.path("there"), "--server", service.address)
    for name in ("displacement.mha", "inverse_displacement.mha"):
        with open(os.path.join(out, name), "rb") as a, open(service.path("there", name), "rb") as b:
            assert a.read() == b.read(), name + " differs from that of a local worker"


def shared_folder(service, slurm):
    """Tokens, logs and inputs by a folder that the nodes see."""
    job = service.submit(*LONG)
    service.wait_for_work(job)
    tokens = os.listdir(service.path("data", "run"))
    equal(len(tokens), 1)
    equal(os.stat(service.path("data", "run", tokens[0])).st_mode & 0o777, 0o600)
    equal(len(os.listdir(service.path("data", "logs"))), 1)
    with open(f"/proc/{worker_of(job)}/cmdline", "rb") as words:
        assert b"blobs/sha256" in words.read()
    service.run("cancel", job, "--server", service.address)
    service.wait_for_state(job, "CANCELLED")
    slurm.wait_until(lambda: not os.listdir(service.path("data", "run")), "the token to be removed")
    done = service.wait_for_state(service.submit(*SHORT), "SUCCEEDED")
    equal(service.metric("saltusd_download_bytes_total"), 0, "bytes of inputs that went over the connection")
    assert done["artifacts"]


def token_on_node(service, slurm):
    """Without one, the token is in no argument and no environment, and in a file of the owner alone."""
    job = service.submit(*LONG)
    service.wait_for_work(job)
    process = worker_of(job)
    with open(f"/proc/{process}/cmdline", "rb") as words:
        words = [word.decode() for word in words.read().split(b"\0")]
    token_file = words[words.index("--token-file") + 1]
    equal(os.stat(token_file).st_mode & 0o777, 0o600)
    with open(token_file, encoding="ascii") as file:
        token = file.read().strip()
    equal(len(token), 64)
    for name in os.listdir("/proc"):
        if name.isdigit():
            for what in ("cmdline", "environ"):
                try:
                    with open(f"/proc/{name}/{what}", "rb") as found:
                        assert token.encode() not in found.read(), f"the token is in {what} of process {name}"
                except OSError:
                    pass  # it has ended
    assert token not in service.told()
    service.run("cancel", job, "--server", service.address)
    service.wait_for_state(job, "CANCELLED")
    slurm.wait_until(lambda: not os.path.exists(os.path.dirname(token_file)), "the folder on the node to be removed")


def cancel(service, slurm):
    """A running one stops by its heartbeat, a waiting one by scancel; neither is left in Slurm."""
    running = service.submit(*LONG)
    service.wait_for_work(running)
    slurm.run("scontrol", "update", "nodename=" + slurm.host, "state=drain", "reason=test")
    waiting = service.submit(*LONG)
    found = service.wait(waiting, lambda j: j.get("batch_id"), "to be in Slurm")
    equal(found["progress"]["stage"], "waiting")
    for job in (waiting, running):
        service.run("cancel", job, "--server", service.address)
        service.wait_for_state(job, "CANCELLED")
    slurm.wait_until(lambda: not names_of_live(slurm), "Slurm's queue to be empty")


def node_drain(service, slurm):
    """What runs on a node that is drained goes on; what waits for it waits as long as it takes, and loses nothing."""
    running = service.submit(*STEPS)
    service.wait_for_work(running)
    slurm.run("scontrol", "update", "nodename=" + slurm.host, "state=drain", "reason=test")
    waiting = service.submit(*SHORT)
    service.wait(waiting, lambda j: j.get("batch_id"), "to be in Slurm")
    equal(service.wait_for_state(running, "SUCCEEDED")["attempt"], 1)
    # Longer than two leases.
    since = time.monotonic()
    found = service.wait(waiting, lambda j: time.monotonic() - since > 11, "to have waited for long")
    equal((found["state"], found["attempt"], found["progress"]["stage"]), ("RUNNING", 1, "waiting"))
    slurm.run("scontrol", "update", "nodename=" + slurm.host, "state=resume")
    done = service.wait_for_state(waiting, "SUCCEEDED")
    equal(done["attempt"], 1)
    assert "last_loss" not in done, done


def killed_job(service, slurm):
    """A worker that is killed is known as soon as Slurm knows, and the next attempt goes on from the checkpoint."""
    worker_is_killed(service)
    slurm.wait_until(lambda: not names_of_live(slurm), "Slurm's queue to be empty")


def cancelled_by_others(service, slurm):
    """Somebody takes the Slurm job away: a fresh attempt with another one."""
    job = service.submit(*LONG)
    first = service.wait_for_work(job)["batch_id"]
    slurm.run("scancel", first)
    found = service.wait_for_work(job, attempt=2)
    assert found["batch_id"] != first, found
    assert found["last_loss"]["reason"] in ("BATCH_CANCELLED", "WORKER_EXITED"), found["last_loss"]
    equal(len(names_of_live(slurm)), 1)


def node_failure(service, slurm):
    """A node that is set down takes its jobs with it: a fresh attempt when it is back."""
    job = service.submit(*LONG)
    service.wait_for_work(job)
    slurm.run("scontrol", "update", "nodename=" + slurm.host, "state=down", "reason=test")
    lost = service.wait(job, lambda j: "last_loss" in j, "the loss to be known")
    equal(lost["last_loss"]["reason"], "NODE_FAILED")
    # Unless it has come back by itself.
    slurm.run("scontrol", "update", "nodename=" + slurm.host, "state=resume", check=False)
    service.wait_for_work(job, attempt=2)


def time_limit(service, slurm):
    """Slurm's own limit costs an attempt; the job's own fails it. Slurm's are minutes, so it is told to hurry."""
    job = service.submit(*LONG)
    found = service.wait_for_work(job)
    slurm.run("scontrol", "update", "jobid=" + found["batch_id"], "EndTime=now+2")
    lost = service.wait(job, lambda j: "last_loss" in j, "the loss to be known")
    equal(lost["last_loss"]["reason"], "BATCH_TIME_LIMIT")
    service.wait_for_work(job, attempt=2)
    own = service.submit(*LONG, "--wall-time", "0.03")
    failed = service.wait_for_state(own, "FAILED")
    equal(failed["failure"]["reason"], "WALL_TIME")


def never_starts(service, slurm):
    """Why a job waits is shown; what Slurm can never start fails with a sentence, and is no crash of a worker. What waits
    for a node that is drained goes on waiting."""
    slurm.run("scontrol", "update", "partitionname=all", "MaxTime=60")
    for more, reason, asks in ((["--memory", "100"], "Requested node configuration is not available", "100.0 GiB"),
                               (["--threads", "64"], "PartitionConfig", "64 threads"),
                               (["--wall-time", "120"], "PartitionTimeLimit", "7200 s")):
        job = service.submit(*SHORT, *more)
        service.wait(job, lambda j: reason in j.get("progress", {}).get("waiting_for", ""), "the reason to be shown")
        failed = service.wait_for_state(job, "FAILED")
        equal((failed["failure"]["reason"], failed["attempt"]), ("BATCH_NEVER_STARTS", 1), failed)
        for text in (reason, asks):
            assert text in failed["failure"]["message"], failed["failure"]
    slurm.wait_until(lambda: not names_of_live(slurm), "Slurm's queue to be empty")
    slurm.run("scontrol", "update", "nodename=" + slurm.host, "state=drain", "reason=test")
    waiting = service.submit(*SHORT)
    service.wait(waiting, lambda j: "DRAINED" in j.get("progress", {}).get("waiting_for", ""), "the reason to be shown")
    text = service.run("get", waiting, "--server", service.address)
    assert "waits for: " in text and "DRAINED" in text, text
    # Longer than the patience.
    since = time.monotonic()
    found = service.wait(waiting, lambda j: time.monotonic() - since > 5, "to have waited for long")
    equal((found["state"], found["attempt"]), ("RUNNING", 1))
    slurm.run("scontrol", "update", "nodename=" + slurm.host, "state=resume")
    equal(service.wait_for_state(waiting, "SUCCEEDED")["attempt"], 1)


def daemon_restart(service, slurm):
    """kill -9, and an orderly stop: jobs that run and jobs that wait are the same afterwards, none twice."""
    running = service.submit(*LONG)
    before = service.wait_for_work(running)
    # The second core is taken by another one, so that the third waits.
    other = service.submit(*LONG)
    service.wait_for_work(other)
    waiting = service.submit(*SHORT)
    queued = service.wait(waiting, lambda j: j.get("batch_id"), "to be in Slurm")
    for how in (signal.SIGKILL, signal.SIGTERM):
        code = service.kill(how)
        equal(code, -signal.SIGKILL if how == signal.SIGKILL else 0, "exit code of the daemon")
        service.start()
        found = service.wait_for_work(running)
        equal((found["attempt"], found["batch_id"]), (1, before["batch_id"]))
        iteration = found["progress"]["iteration"]
        service.wait(running, lambda j: j["progress"]["iteration"] > iteration, "to get on")
        found = service.get(waiting)
        equal((found["state"], found["attempt"], found["batch_id"]), ("RUNNING", 1, queued["batch_id"]))
        equal(len(names_of_live(slurm)), 3)
    service.run("cancel", other, "--server", service.address)
    done = service.wait_for_state(waiting, "SUCCEEDED")
    equal((done["attempt"], done["batch_id"]), (1, queued["batch_id"]))
    # What ends while no daemon runs is known to the next.
    service.kill()
    os.kill(worker_of(running), signal.SIGKILL)
    slurm.wait_until(lambda: not names_of_live(slurm), "Slurm's queue to be empty")
    service.start()
    found = service.wait_for_work(running, attempt=2)
    equal(len(names_of_live(slurm)), 1)


def killed_at_submission(service, slurm):
    """kill -9 right before and right after sbatch: the job is done, and in Slurm once for each attempt."""
    for place, attempts in (("slurm.submit.before", 2), ("slurm.submit.after", 1)):
        service.kill()
        service.place = place
        service.start()
        service.arm()
        job = service.submit(*SHORT)
        service.wait_for_death()
        submitted = [name for _, name, _ in slurm.jobs() if job in name]
        equal(len(submitted), 0 if place == "slurm.submit.before" else 1, f"submissions at a death at {place}")
        service.start()
        done = service.wait_for_state(job, "SUCCEEDED")
        equal(done["attempt"], attempts, f"attempts after a death at {place}")
        equal(len([name for _, name, _ in slurm.jobs() if job in name]), 1, f"submissions after a death at {place}")


def controller_away(service, slurm):
    """slurmctld is gone for a while: what runs goes on and ends, what is new waits for it."""
    running = service.submit(*STEPS)
    service.wait_for_work(running)
    slurm.stop("slurmctld")
    later = service.submit(*SHORT)
    equal(service.wait_for_state(running, "SUCCEEDED")["attempt"], 1)
    slurm.wait_until(lambda: "Slurm does not answer" in service.told(), "the daemon to miss Slurm")
    equal(service.get(later)["state"], "RUNNING")
    slurm.start("slurmctld")
    done = service.wait_for_state(later, "SUCCEEDED")
    equal(done["attempt"], 1)
    equal(len([name for _, name, _ in slurm.jobs() if later in name]), 1, "submissions of the job")


def several_hosts(service, slurm):
    """Workers on other hosts come in with mutual TLS; one whose cable is pulled loses its job to another host."""
    first = service.submit(*LONG, "--threads", "2")
    second = service.submit(*LONG, "--threads", "2")
    numbers = {job: service.wait_for_work(job)["batch_id"] for job in (first, second)}
    hosts = {job: slurm.run("squeue", "-h", "-j", number, "-o", "%N").strip() for job, number in numbers.items()}
    equal(set(hosts.values()), set(slurm.nodes), "hosts of the two")
    service.run("cancel", first, "--server", service.address)
    service.wait_for_state(first, "CANCELLED")
    slurm.hosts.set_link(hosts[second], "down")
    lost = service.wait(second, lambda j: "last_loss" in j, "the loss to be known")
    equal(lost["last_loss"]["reason"], "LEASE_EXPIRED")
    found = service.wait_for_work(second, attempt=2)
    equal(slurm.run("squeue", "-h", "-j", found["batch_id"], "-o", "%N").strip(), hosts[first], "host of the next attempt")
    # The first worker finds out by itself that nobody wants its work.
    slurm.wait_until(lambda: len(workers_of(second)) == 1, "the worker that was cut off to end")
    slurm.hosts.set_link(hosts[second], "up")
    equal(service.get(second)["attempt"], 2)
    service.run("cancel", second, "--server", service.address)
    service.wait_for_state(second, "CANCELLED")


def pilot_array(service, slurm):
    """Many short jobs by an array of pilots: none twice, none lost; the pilots go when there is nothing to do."""
    jobs = [service.submit(*SHORT) for _ in range(8)]
    for job in jobs:
        done = service.wait_for_state(job, "SUCCEEDED")
        equal(done["attempt"], 1)
    names = {name.split("-", 2)[2] for _, name, _ in slurm.jobs()}
    equal(names, {"pilots"}, "what is submitted")
    assert len(slurm.jobs()) < len(jobs), slurm.jobs()
    refused = service.refusal("--threads", "2")
    assert "EXCEEDS_BUDGET" in refused or "ask for fewer threads" in refused, refused
    slurm.wait_until(lambda: not names_of_live(slurm), "the pilots to go")
    equal(service.wait_for_state(service.submit(*SHORT), "SUCCEEDED")["attempt"], 1)


CASES = {case.__name__: case for case in (
    normal_run, shared_folder, token_on_node, cancel, node_drain, killed_job, cancelled_by_others, node_failure,
    time_limit, never_starts, daemon_restart, killed_at_submission, controller_away, several_hosts,
    pilot_array)}


def run_case(folder, hosts=None):
    with cluster.Cluster(os.path.join(folder, "slurm"), hosts=hosts) as slurm:
        more = ["--launcher", "slurm", "--slurm-poll-seconds", "0.5"]
        if options.case == "shared_folder":
            more += ["--slurm-shared-data", os.path.join(folder, "data"), "--metrics", "127.0.0.1:0"]
        if options.case == "never_starts":
            more += ["--slurm-patience-seconds", "3"]
        if options.case == "pilot_array":
            more += ["--slurm-pilots", "2", "--slurm-pilot-idle-seconds", "3", "--threads-per-job", "1",
                     "--slurm-pilot-memory", "1"]
        if hosts:
            more += tls_options(folder, hosts.address[hosts.names[0]]) + worker_tls(folder, "slurm-")
        with Service(options.programs, folder, slurm, more) as service:
            try:
                CASES[options.case](service, slurm)
            except BaseException:
                print(service.told(), slurm.jobs(), sep="\n")
                raise
            finally:
                # No worker of the test outlives it.
                slurm.run("scancel", "--me", check=False)
                service.kill()
                slurm.wait_until(lambda: not names_of_live(slurm), "Slurm's queue to be empty")


def main():
    needs_hosts = options.case == "several_hosts"
    reason = cluster.why_not() or (cluster.why_no_hosts() if needs_hosts else "")
    if reason:
        print("SKIPPED: " + reason)
        return 0
    with tempfile.TemporaryDirectory(prefix="saltus-slurm-") as folder:
        os.makedirs(os.path.join(folder, "slurm"))
        os.chmod(folder, 0o755)
        if not needs_hosts:
            run_case(folder)
            return 0
        with cluster.Hosts("login", "node1", "node2") as hosts:
            run_case(folder, hosts)
    return 0


sys.exit(main())
