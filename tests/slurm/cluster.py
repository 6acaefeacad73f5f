"""A Slurm of one machine for a test: munged, slurmctld and slurmd as children of this process, ended with it.

Works as root in a container: no systemd, no cgroups, no accounting. Everything lies in one folder, ports are free ones.
"""

import os
import pwd
import shutil
import signal
import socket
import subprocess
import time

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "scontrol")


def why_not():
    """What keeps a cluster from being started here; empty when nothing does."""
    missing = [name for name in PROGRAMS if not find(name)]
    if missing:
        return f"{', '.join(missing)} not installed (Debian: slurmctld slurmd slurm-client munge)"
    if os.geteuid() != 0:
        return "munged, slurmctld and slurmd of the test need root"
    return ""


def find(name):
    return shutil.which(name, path=os.environ.get("PATH", "") + ":/usr/sbin:/sbin")


def free_ports(count):
    taken = [socket.socket() for _ in range(count)]
    for one in taken:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in taken]
    for one in taken:
        one.close()
    return ports


class Cluster:
    """Use with `with`. `nodes` of the same machine, each a slurmd of its own when there are several."""

    def __init__(self, folder, cpus=2, patience=60):
        self.folder = str(folder)
        self.cpus = cpus
        self.patience = patience
        self.children = {}

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def __enter__(self):
        try:
            self.configure()
            self.start_munged()
            self.start("slurmctld")
            self.start("slurmd")
            self.wait_until(lambda: "idle" in self.run("sinfo", "-h", "-o", "%t", check=False), "the node to be idle")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for name in ("slurmd", "slurmctld", "munged"):
            self.stop(name)

    def configure(self):
        os.makedirs(self.path("state"))
        os.makedirs(self.path("spool"))
        controller, node = free_ports(2)
        with open(self.path("munge.key"), "wb") as key:
            key.write(os.urandom(1024))
        host = socket.gethostname().split(".")[0]
        with open(self.path("slurm.conf"), "w", encoding="ascii") as conf:
            conf.write(f"""ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmdPort={node}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={self.path("munge", "socket")}
CredType=cred/munge
StateSaveLocation={self.path("state")}
SlurmdSpoolDir={self.path("spool")}
SlurmctldPidFile={self.path("slurmctld.pid")}
SlurmdPidFile={self.path("slurmd.pid")}
SlurmctldLogFile={self.path("slurmctld.log")}
SlurmdLogFile={self.path("slurmd.log")}
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/builtin
SchedulerParameters=batch_sched_delay=0,sched_interval=1,sched_min_interval=0
ReturnToService=2
SlurmdTimeout=300
InactiveLimit=0
KillWait=5
MinJobAge=300
SlurmdParameters=config_overrides
OverTimeLimit=0
MailProg=/bin/true
NodeName={host} NodeAddr=127.0.0.1 CPUs={self.cpus} RealMemory=8000 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
""")
        self.host = host
        os.environ["SLURM_CONF"] = self.path("slurm.conf")

    def start_munged(self):
        # munged trusts neither a folder that others could write to, nor a key of somebody else's.
        user = pwd.getpwnam("munge")
        for name in ("munge.key",):
            os.chown(self.path(name), user.pw_uid, user.pw_gid)
            os.chmod(self.path(name), 0o400)
        os.makedirs(self.path("munge"))
        os.chown(self.path("munge"), user.pw_uid, user.pw_gid)
        os.chmod(self.folder, 0o755)
        log = open(self.path("munged.out"), "wb")
        self.children["munged"] = subprocess.Popen(
            [find("munged"), "--foreground", "--force", "--key-file=" + self.path("munge.key"),
             "--socket=" + self.path("munge", "socket"), "--pid-file=" + self.path("munge", "pid"),
             "--seed-file=" + self.path("munge", "seed"), "--log-file=" + self.path("munge", "log")],
            stdout=log, stderr=log, user=user.pw_uid, group=user.pw_gid, extra_groups=[])
        self.wait_until(lambda: os.path.exists(self.path("munge", "socket")), "munged")

    def start(self, name):
        log = open(self.path(name + ".out"), "ab")
        more = ["-N", self.host] if name == "slurmd" else ["-i"]
        self.children[name] = subprocess.Popen([find(name), "-D", "-f", self.path("slurm.conf")] + more, stdout=log,
                                               stderr=log)

    def stop(self, name, how=signal.SIGTERM):
        child = self.children.pop(name, None)
        if child is None:
            return
        child.send_signal(how)
        try:
            child.wait(20)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()

    def run(self, *command, check=True):
        result = subprocess.run(command, capture_output=True, text=True, timeout=self.patience, check=False)
        if check and result.returncode != 0:
            raise RuntimeError(f"{' '.join(command)}: {result.stderr}")
        return result.stdout

    def jobs(self):
        """[(id, name, state)] of all that Slurm still knows."""
        lines = self.run("squeue", "--noheader", "--states=all", "--array", "-o", "%i|%j|%T").splitlines()
        return [tuple(line.split("|")) for line in lines]

    def wait_until(self, condition, what):
        """A condition of another program, asked for again and again; never a fixed time."""
        until = time.monotonic() + self.patience
        while not condition():
            for name, child in self.children.items():
                if child.poll() is not None:
                    raise RuntimeError(f"{name} has ended with {child.returncode}: {self.logs()}")
            if time.monotonic() > until:
                raise RuntimeError(f"waited {self.patience} s for {what} in vain: {self.logs()}")
            time.sleep(0.05)

    def logs(self):
        text = ""
        for name in ("munged.out", "munge/log", "slurmctld.out", "slurmctld.log", "slurmd.out", "slurmd.log"):
            if os.path.exists(self.path(name)):
                with open(self.path(name), errors="replace", encoding="utf-8") as log:
                    text += f"\n{name}:\n" + log.read()[-3000:]
        return text
