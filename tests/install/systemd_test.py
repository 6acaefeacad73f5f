"""The installed service under a real systemd, with all that its unit denies: it serves, gets its credentials, is started again
when it hangs or is killed, and stops in order. In the root of package_test, in namespaces of its own."""

import glob
import os
import shutil
import signal
import subprocess
import tempfile

from service import arguments, run, skip

options = arguments()
cache = os.path.join(os.path.dirname(options.programs), "install")
base, archives = os.path.join(cache, "bookworm.tar"), os.path.join(cache, "archives")
packages = glob.glob(os.path.join(cache, "packages/saltus-*.deb"))
if os.geteuid() != 0:
    skip("only root can boot a root folder")
if not os.path.exists(base) or len(packages) != 3:
    skip("package_test has left no base and packages")
if not os.path.isdir("/sys/fs/cgroup/systemd"):
    skip("there is no control group hierarchy of systemd to boot in")
ENVIRONMENT = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8", "DEBIAN_FRONTEND": "noninteractive",
               "OMP_WAIT_POLICY": "passive"}


# Version 1 of control groups: the one where a test may have a limit of memory of its own.
HIERARCHIES = [name for name in ("systemd", "memory")
               if os.path.exists(os.path.join("/sys/fs/cgroup", name, "cgroup.procs"))]


class Machine:
    """What runs in a root folder from boot to the end of a with block."""

    def __init__(self, root):
        self.root = root
        self.group = "saltus-test-" + os.path.basename(os.path.dirname(root))

    def __enter__(self):
        for name in HIERARCHIES:
            os.mkdir(os.path.join("/sys/fs/cgroup", name, self.group))
        boot = os.path.join(os.path.dirname(os.path.abspath(__file__)), "boot")
        self.process = subprocess.Popen([boot, self.root, self.group, "basic.target"], stdin=subprocess.DEVNULL,
                                        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        while True:
            assert self.process.poll() is None, "systemd does not boot: " + self.process.stdout.read()
            children = run("pgrep", "--parent", str(self.process.pid), code=None).split()
            if children and "systemd" in run("ps", "-o", "comm=", "-p", children[0], code=None):
                self.init = children[0]
                if "running" in self.call("systemctl", "is-system-running", "--wait", code=None):
                    return self

    def call(self, *command, code=0):
        done = subprocess.run(["nsenter", "--target", self.init, "--all", "--wd=/", *command], stdin=subprocess.DEVNULL,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=ENVIRONMENT, check=False)
        if code is not None and done.returncode != code:
            log = subprocess.run(["nsenter", "--target", self.init, "--all", "--wd=/", "journalctl", "-n", "20"],
                                 stdout=subprocess.PIPE, text=True, env=ENVIRONMENT, check=False)
            raise AssertionError(f"{command} ended with {done.returncode}:\n{done.stdout}\n{log.stdout}")
        return done.stdout

    def show(self, what):
        return self.call("systemctl", "show", "--property", what, "--value", "saltusd").strip()

    def wait_for(self, what, value):
        while self.show(what) != value:
            pass

    def __exit__(self, *_):
        os.kill(int(self.init), signal.SIGKILL)
        self.process.communicate()
        for name in HIERARCHIES:
            for folder, _, _ in sorted(os.walk(os.path.join("/sys/fs/cgroup", name, self.group)), reverse=True):
                os.rmdir(folder)


def install(root):
    run("tar", "--extract", "--numeric-owner", "--file", base, "--directory", root)
    shutil.copy("/etc/resolv.conf", os.path.join(root, "etc/resolv.conf"))
    for package in glob.glob(archives + "/*.deb"):
        os.link(package, os.path.join(root, "var/cache/apt/archives", os.path.basename(package)))
    for package in packages:
        shutil.copy(package, os.path.join(root, "tmp"))
    enter = ("unshare", "--mount", "sh", "-c", 'mount -t proc proc "$0/proc" && exec chroot "$0" "$@"', root)
    done = subprocess.run([*enter, "apt-get", "--yes", "--quiet", "--no-install-recommends", "install", "systemd",
                           *("/tmp/" + os.path.basename(package) for package in packages)],
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=ENVIRONMENT, check=False)
    if "Could not connect" in done.stdout or "Could not resolve" in done.stdout:
        skip("apt cannot fetch systemd for the root")
    assert done.returncode == 0, done.stdout
    for package in glob.glob(os.path.join(root, "var/cache/apt/archives/*.deb")):
        if not os.path.exists(os.path.join(archives, os.path.basename(package))):
            shutil.copy(package, archives)
    # What systemd waits for before it ends what hangs, shorter; and the port one that nobody has.
    override = os.path.join(root, "etc/systemd/system/saltusd.service.d")
    os.makedirs(override)
    with open(os.path.join(override, "test.conf"), "w", encoding="ascii") as file:
        file.write("[Service]\nWatchdogSec=4s\nRestartSec=0\n")


def out_of_memory(machine, as_meier):
    """A worker for which the kernel has no memory is that job's end: the daemon goes on, and says so."""
    before = machine.show("MainPID")
    machine.call("systemctl", "set-property", "--runtime", "saltusd", "MemoryMax=64M")
    as_meier("saltus phantom slip --size 96,96,96 --out large")
    told = as_meier("saltus register --server $SALTUS_SERVER --fixed large/fixed.mha --moving large/moving.mha "
                    "--similarity ssd --out large-result 2>&1 || echo ended with $?", code=None)
    assert "no memory was left" in told and "ended with" in told, told
    listed = as_meier("saltus list")
    assert "FAILED" in listed, listed
    machine.call("systemctl", "set-property", "--runtime", "saltusd", "MemoryMax=infinity")
    assert (machine.show("MainPID"), machine.show("NRestarts")) == (before, "0"), machine.call("journalctl", "-n", "30")
    as_meier("saltus register --server $SALTUS_SERVER --fixed pair/fixed.mha --moving pair/moving.mha --similarity ssd "
             "--preset fast --out afterwards; test -s afterwards/report.html")


def check(machine):
    machine.call("systemctl", "start", "saltusd")
    assert machine.show("StatusText") == "serves unix:/run/saltus/saltusd.sock"
    status = machine.call("cat", f"/proc/{machine.show('MainPID')}/status")
    for said in ("NoNewPrivs:\t1", "Seccomp:\t2", "CapBnd:\t0000000000000000"):
        assert said in status, status

    def as_meier(script, code=0):
        return machine.call("setpriv", "--reuid", "meier", "--regid", "meier", "--init-groups", "sh", "-euc",
                            "cd /home/meier; export SALTUS_SERVER=unix:/run/saltus/saltusd.sock; " + script, code=code)

    machine.call("adduser", "--quiet", "--disabled-password", "--gecos", "", "meier")
    machine.call("adduser", "--quiet", "meier", "saltus")
    as_meier("saltus phantom slip --size 40,40 --out pair")
    job = "--fixed pair/fixed.mha --moving pair/moving.mha --similarity ssd --preset fast"
    as_meier(f"saltus register --server $SALTUS_SERVER {job} --out result; test -s result/report.html")

    if "memory" in HIERARCHIES:
        out_of_memory(machine, as_meier)
    else:
        print("no control group of version 1 with memory here: no worker runs out of it")

    # As the runbook says it.
    machine.call("sh", "-euc", """
      saltus-certificates server /root/c localhost 127.0.0.1
      saltus-certificates client /root/c meier@hospital.example
      install -m 0600 /root/c/server.crt /root/c/server.key /etc/saltus/tls/
      install -m 0600 /root/c/authority.crt /etc/saltus/tls/clients.crt
      echo 'meier@hospital.example = submitter' >> /etc/saltus/roles
      sed -i 's/^#listen = 0.0.0.0:50051/listen = 127.0.0.1:0/; s/^#tls/tls/; s/^#roles/roles/' /etc/saltus/saltusd.conf
      systemctl restart saltusd""")
    listening = []  # the journal may be behind the restart
    while not listening:
        log = machine.call("journalctl", "--unit", "saltusd", "--output", "cat")
        listening = [line for line in log.splitlines() if line.endswith("with mutual TLS")]
    address = listening[-1].split()[2]
    machine.call("saltus", "list", "--server", address, "--tls-ca", "/root/c/authority.crt", "--tls-cert",
                 "/root/c/clients/meier@hospital.example.crt", "--tls-key", "/root/c/clients/meier@hospital.example.key")

    # One that hangs is ended by the watchdog, one that is killed is started again; what was answered for is there.
    restarts = int(machine.show("NRestarts"))
    machine.call("systemctl", "kill", "--kill-whom=main", "--signal=STOP", "saltusd")
    machine.wait_for("NRestarts", str(restarts + 1))
    machine.wait_for("ActiveState", "active")  # the restart counts before there is a process
    machine.call("systemctl", "kill", "--kill-whom=main", "--signal=KILL", "saltusd")
    machine.wait_for("NRestarts", str(restarts + 2))
    machine.wait_for("ActiveState", "active")
    listed = as_meier("saltus list")
    assert "SUCCEEDED" in listed, listed + machine.call("journalctl", "--unit", "saltusd", "--lines=30")
    machine.call("systemctl", "stop", "saltusd")
    assert machine.show("Result") == "success", machine.show("Result")
    machine.call("test", "!", "-e", "/run/credentials/saltusd.service/tls_server.key")


with tempfile.TemporaryDirectory() as there:
    folder = os.path.join(there, "root")
    os.mkdir(folder)
    install(folder)
    with Machine(folder) as machine:
        check(machine)
