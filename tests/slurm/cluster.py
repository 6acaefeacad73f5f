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


def why_no_hosts():
    """What keeps several hosts from being made here; empty when nothing does."""
    if not find("ip"):
        return "ip not installed (Debian: iproute2)"
    probe = f"saltus{os.getpid()}p"
    made = subprocess.run(["ip", "netns", "add", probe], capture_output=True, text=True, check=False)
    if made.returncode != 0:
        return "no network namespace can be made here: " + made.stderr.strip()
    bridge = subprocess.run(["ip", "-n", probe, "link", "add", "br0", "type", "bridge"], capture_output=True, text=True,
                            check=False)
    subprocess.run(["ip", "netns", "delete", probe], check=False)
    return "" if bridge.returncode == 0 else "no bridge can be made here: " + bridge.stderr.strip()


class Hosts:
    """Hosts of one machine: network namespaces on one bridge, each with a name and an address of its own."""

    def __init__(self, *names):
        self.names = names
        self.address = {name: f"10.77.0.{number}" for number, name in enumerate(names, start=1)}

    def space(self, name):
        return f"saltus{os.getpid()}{name}"

    def __enter__(self):
        try:
            first = self.space(self.names[0])
            for name in self.names:
                self.ip("netns", "add", self.space(name))
                self.ip("-n", self.space(name), "link", "set", "lo", "up")
            self.ip("-n", first, "link", "add", "br0", "type", "bridge")
            self.ip("-n", first, "address", "add", self.address[self.names[0]] + "/24", "dev", "br0")
            self.ip("-n", first, "link", "set", "br0", "up")
            for name in self.names[1:]:
                self.ip("-n", first, "link", "add", name, "type", "veth", "peer", "name", "eth0", "netns",
                        self.space(name))
                self.ip("-n", first, "link", "set", name, "master", "br0", "up")
                self.ip("-n", self.space(name), "address", "add", self.address[name] + "/24", "dev", "eth0")
                self.ip("-n", self.space(name), "link", "set", "eth0", "up")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for name in self.names:
            subprocess.run(["ip", "netns", "delete", self.space(name)], capture_output=True, check=False)

    def set_link(self, name, state):
        """Plugs the cable of a host in, "up", or pulls it, "down"."""
        self.ip("-n", self.space(self.names[0]), "link", "set", name, state)

    def command(self, name, *words):
        """The same command on that host."""
        return ["ip", "netns", "exec", self.space(name), "unshare", "--uts", "sh", "-c",
                'hostname "$0" && exec "$@"', name, *words]

    @staticmethod
    def ip(*words):
        done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"ip {' '.join(words)}: {done.stderr}")


class Cluster:
    """Use with `with`. Without `hosts` everything is on this one; with them the first is where the controller and the
    commands run, and the others are nodes."""

    def __init__(self, folder, cpus=2, patience=120, hosts=None):
        self.folder = str(folder)
        self.cpus = cpus
        self.patience = patience
        self.hosts = hosts
        self.children = {}
        self.host = hosts.names[1] if hosts else socket.gethostname().split(".")[0]
        self.nodes = list(hosts.names[1:]) if hosts else [self.host]

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def __enter__(self):
        try:
            self.configure()
            self.start_munged()
            self.start("slurmctld")
            for node in self.nodes:
                self.start("slurmd", node)
            self.wait_until(lambda: self.run("sinfo", "-h", "-N", "-o", "%t", check=False).split() ==
                            ["idle"] * len(self.nodes), "the nodes to be idle")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for name in list(self.children)[::-1]:
            self.stop(name)

    def configure(self):
        os.makedirs(self.path("state"))
        for node in self.nodes:
            os.makedirs(self.path("spool-" + node))
        controller, node = free_ports(2)
        with open(self.path("munge.key"), "wb") as key:
            key.write(os.urandom(1024))
        controller_host = self.hosts.names[0] if self.hosts else self.host
        address = self.hosts.address if self.hosts else {self.host: "127.0.0.1"}
        # Nothing uses them; the newer kind would have to be there all the same.
        with open(self.path("cgroup.conf"), "w", encoding="ascii") as conf:
            conf.write("CgroupPlugin=cgroup/v1\n")
        with open(self.path("slurm.conf"), "w", encoding="ascii") as conf:
            conf.write(f"""ClusterName=test
SlurmctldHost={controller_host}({address[controller_host]})
SlurmctldPort={controller}
SlurmdPort={node}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={self.path("munge", "socket")}
CredType=cred/munge
StateSaveLocation={self.path("state")}
SlurmdSpoolDir={self.path("spool-%n")}
SlurmctldPidFile={self.path("slurmctld.pid")}
SlurmdPidFile={self.path("slurmd-%n.pid")}
SlurmctldLogFile={self.path("slurmctld.log")}
SlurmdLogFile={self.path("slurmd-%n.log")}
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
PartitionName=all Nodes={",".join(self.nodes)} Default=YES MaxTime=INFINITE State=UP
""")
            for node in self.nodes:
                conf.write(f"NodeName={node} NodeAddr={address[node]} CPUs={self.cpus} RealMemory=8000 State=UNKNOWN\n")
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

    def here(self, *words):
        """A command where users are."""
        return self.hosts.command(self.hosts.names[0], *words) if self.hosts else list(words)

    def start(self, name, node=None):
        log = open(self.path(name + ".out"), "ab")
        words = [find(name), "-D", "-f", self.path("slurm.conf")] + (["-N", node] if node else ["-i"])
        if self.hosts:
            words = self.hosts.command(node or self.hosts.names[0], *words)
        self.children[name + (node or "")] = subprocess.Popen(words, stdout=log, stderr=log)

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
        result = subprocess.run(self.here(*command), capture_output=True, text=True, timeout=self.patience, check=False)
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
        for name in ["munged.out", "munge/log"] + sorted(os.listdir(self.folder)):
            if name.endswith((".out", "log")) and os.path.exists(self.path(name)):
                with open(self.path(name), errors="replace", encoding="utf-8") as log:
                    text += f"\n{name}:\n" + log.read()[-3000:]
        return text
