"""Installs the packages of this build into a clean Debian made by debootstrap, runs them there, upgrades and purges them.

The clean root and what apt has fetched are kept in build/install; the first run needs the network and some minutes.
"""

import argparse
import glob
import os
import shutil
import stat
import subprocess
import tempfile

parser = argparse.ArgumentParser()
for name in ("source", "build", "cpack", "mirror"):
    parser.add_argument("--" + name, required=True)
options = parser.parse_args()
cache = os.path.join(options.build, "install")
base, archives = os.path.join(cache, "bookworm.tar"), os.path.join(cache, "archives")
ENVIRONMENT = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8", "DEBIAN_FRONTEND": "noninteractive",
               "OMP_WAIT_POLICY": "passive"}


class Skip(Exception):
    pass


def run(*command, code=0, env=None, cwd=None):
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
                          env=env, cwd=cwd)
    if code is not None and done.returncode != code:
        raise AssertionError(f"{command} ended with {done.returncode}:\n{done.stdout}")
    return done.stdout


class Root:
    """A Debian in a folder. Its /proc is mounted for one command at a time, and goes with it."""

    def __init__(self, folder):
        self.folder = folder

    def __truediv__(self, path):
        return os.path.join(self.folder, path)

    def command(self, *command):
        return ("unshare", "--mount", "sh", "-c", 'mount -t proc proc "$0/proc" && exec chroot "$0" "$@"', self.folder,
                *command)

    def run(self, *command, code=0):
        return run(*self.command(*command), code=code, env=ENVIRONMENT)

    def run_as(self, user, *command, code=0):
        return self.run("setpriv", "--reuid", user, "--regid", user, "--init-groups", *command, code=code)

    def apt(self, *command, code=0):
        return self.run("apt-get", "--yes", "--quiet", "--no-install-recommends", *command, code=code)


def make_base():
    """The clean root as an archive, with apt's lists."""
    if os.path.exists(base):
        return
    with tempfile.TemporaryDirectory() as there:
        root = Root(os.path.join(there, "root"))
        done = subprocess.run(["debootstrap", "--variant=minbase", "bookworm", root.folder, options.mirror],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        if done.returncode != 0:
            raise Skip("debootstrap cannot make a root here: " + " / ".join(done.stdout.strip().splitlines()[-2:]))
        shutil.copy("/etc/resolv.conf", root / "etc/resolv.conf")
        root.apt("update")
        root.run("apt-get", "clean")
        run("tar", "--create", "--numeric-owner", "--file", base + ".new", "--directory", root.folder, ".")
    os.rename(base + ".new", base)


def has_failed(told):
    return "\nE: " in "\n" + told


def install(root, *packages):
    """What apt has fetched once is not fetched again."""
    told = root.apt("install", "--no-download", *packages, code=None)
    if has_failed(told):
        fetched = root.apt("install", "--download-only", *packages, code=None)
        if has_failed(fetched):
            # What the lists name is gone from the mirror when they are old.
            fetched = root.apt("update", code=None) + root.apt("install", "--download-only", *packages, code=None)
        if "Could not connect" in fetched or "Could not resolve" in fetched or "Unable to fetch" in fetched:
            raise Skip("apt cannot fetch what the packages need: " + fetched.strip().splitlines()[-1])
        for package in glob.glob(root / "var/cache/apt/archives/*.deb"):
            if not os.path.exists(os.path.join(archives, os.path.basename(package))):
                shutil.copy(package, archives)
        root.apt("install", *packages)


def service(root):
    """What the unit starts, as its user; the folder that systemd would make is there."""
    with open(root / "lib/systemd/system/saltusd.service", encoding="utf-8") as unit:
        start = [line for line in unit if line.startswith("ExecStart=")][0].strip().removeprefix("ExecStart=")
    root.run("install", "-d", "-o", "saltus", "-g", "saltus", "-m", "0750", "/run/saltus")
    daemon = subprocess.Popen(
        root.command("setpriv", "--reuid", "saltus", "--regid", "saltus", "--init-groups", *start.split()),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)
    said = daemon.stdout.readline()
    if not said.startswith("listening on unix:/run/saltus/saltusd.sock"):
        raise AssertionError(f"{start} said '{said}' and {daemon.communicate()[1]}")
    return daemon


def check(root):
    packages = glob.glob(os.path.join(cache, "packages/*.deb"))
    assert len(packages) == 4, packages
    # No mail address is known that could stand in a package, and nobody has reported a bug yet. The others are meant.
    told = run("lintian", "--allow-root", "--fail-on", "none", "--suppress-tags",
               "bogus-mail-host,bogus-mail-host-in-debian-changelog,initial-upload-closes-no-bugs,"
               "non-standard-dir-perm,non-standard-file-perm", *packages)
    assert "E: " not in told and "W: " not in told, told
    for package in packages:
        shutil.copy(package, root / "tmp")
    for package in glob.glob(os.path.join(archives, "*.deb")):
        os.link(package, os.path.join(root / "var/cache/apt/archives", os.path.basename(package)))

    local = {name: "/tmp/" + os.path.basename(glob.glob(os.path.join(cache, "packages", name + "_*"))[0])
             for name in ("saltus-server", "saltus-worker", "saltus-client", "libsaltus-dev")}
    services = [local[name] for name in ("saltus-server", "saltus-worker", "saltus-client")]
    install(root, *services)

    assert "/var/lib/saltus" in root.run("getent", "passwd", "saltus")
    data = os.stat(root / "var/lib/saltus")
    assert stat.S_IMODE(data.st_mode) == 0o750 and data.st_uid != 0
    wanted = root / "etc/systemd/system/multi-user.target.wants/saltusd.service"
    assert os.path.islink(wanted)
    assert stat.S_IMODE(os.stat(root / "etc/saltus/tls").st_mode) == 0o700

    # One who is in the group saltus may, one who is not may not.
    for user in ("meier", "stranger"):
        root.run("adduser", "--quiet", "--disabled-password", "--gecos", "", user)
    root.run("adduser", "--quiet", "meier", "saltus")
    daemon = service(root)
    try:
        root.run_as("meier", "saltus", "phantom", "slip", "--size", "48,48", "--out", "/home/meier/pair")
        register = ("saltus", "register", "--server", "unix:/run/saltus/saltusd.sock", "--fixed",
                    "/home/meier/pair/fixed.mha", "--moving", "/home/meier/pair/moving.mha", "--out",
                    "/home/meier/result", "--similarity", "ssd", "--format", "mha")
        root.run_as("meier", *register)
        assert os.path.getsize(root / "home/meier/result/report.html") > 0
        assert os.path.getsize(root / "home/meier/result/displacement.mha") > 48 * 48 * 8
        root.run_as("stranger", "saltus", "server", "info", "--server", "unix:/run/saltus/saltusd.sock", code=3)
        assert "SUCCEEDED" in root.run_as("meier", "saltus", "list", "--server", "unix:/run/saltus/saltusd.sock")
        backup = root.run("saltus-backup", "/var/lib/saltus", "/root/backup")
        assert backup.startswith("1 jobs"), backup
    finally:
        daemon.terminate()
        assert daemon.wait(60) == 0, daemon.stderr.read()
    # Without a daemon that stays: the client starts a private one.
    root.run_as("meier", "saltus", "register", *register[4:8], "--similarity", "ssd", "--out", "/home/meier/private")
    root.run("saltus-certificates", "server", "/root/certificates", "localhost")
    for page in ("man1/saltus.1.gz", "man8/saltusd.8.gz", "man8/saltus-worker.8.gz"):
        assert os.path.getsize(root / ("usr/share/man/" + page)) > 0

    # What was set stays through an upgrade.
    with open(root / "etc/saltus/saltusd.conf", "a", encoding="utf-8") as file:
        file.write("slots = 1\n")
    root.run("dpkg", "--install", *services)
    with open(root / "etc/saltus/saltusd.conf", encoding="utf-8") as file:
        assert file.read().endswith("slots = 1\n")

    # What does not need gRPC is enough for a stranger to build on; the rest is built against the same files elsewhere.
    told = root.run("apt-get", "--simulate", "--quiet", "install", "--no-install-recommends", local["libsaltus-dev"])
    for needed in ("libgrpc++-dev", "libeigen3-dev", "libprotobuf-dev", "libssl-dev"):
        assert f"Inst {needed} " in told, told

    told = root.apt("purge", "saltus-server", "saltus-worker", "saltus-client")
    assert "has jobs and results and was left" in told, told
    assert os.path.exists(root / "var/lib/saltus/saltusd.db")
    for gone in ("etc/saltus", "usr/bin/saltusd", "lib/systemd/system/saltusd.service"):
        assert not os.path.exists(root / gone), gone
    assert not os.path.lexists(wanted)


def build_examples(there):
    """libsaltus-dev, unpacked, is enough to build the examples with."""
    run("dpkg-deb", "--extract", glob.glob(os.path.join(cache, "packages/libsaltus-dev_*"))[0], there)
    examples = os.path.join(there, "examples")
    shutil.copytree(os.path.join(options.source, "client/examples"), examples)
    run("cmake", "-S", examples, "-B", examples, f"-DCMAKE_PREFIX_PATH={there}/usr", "-DCMAKE_BUILD_TYPE=Release")
    run("cmake", "--build", examples, "--target", "register_in_process")
    assert "error 0." in run(os.path.join(examples, "register_in_process"))


def main():
    for program in ("debootstrap", "lintian", "dpkg-shlibdeps", "unshare"):
        if not shutil.which(program):
            raise Skip(program + " is not installed")
    if os.geteuid() != 0:
        raise Skip("only root can make a root folder and enter it")
    if subprocess.run(["unshare", "--mount", "true"], capture_output=True, check=False).returncode != 0:
        raise Skip("no mount namespace can be made here")
    os.makedirs(archives, exist_ok=True)
    shutil.rmtree(os.path.join(cache, "packages"), ignore_errors=True)
    run(options.cpack, "--config", os.path.join(options.build, "CPackConfig.cmake"), "-B",
        os.path.join(cache, "packages"))
    make_base()
    with tempfile.TemporaryDirectory() as there:
        build_examples(os.path.join(there, "development"))
        root = Root(os.path.join(there, "root"))
        os.mkdir(root.folder)
        run("tar", "--extract", "--numeric-owner", "--file", base, "--directory", root.folder)
        shutil.copy("/etc/resolv.conf", root / "etc/resolv.conf")
        check(root)


try:
    main()
except Skip as reason:
    print(f"SKIPPED: {reason}")
