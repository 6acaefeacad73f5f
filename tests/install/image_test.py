"""The image of deploy/oci, built by buildah on a base made by debootstrap in place of Debian's own, which no registry gives
here; then the daemon and its health check run in it. Comes after package_test, which leaves base and packages."""

import json
import os
import shutil
import subprocess
import tempfile

from service import arguments, run, skip

options = arguments()
cache = os.path.join(os.path.dirname(options.programs), "install")
base, packages = os.path.join(cache, "bookworm.tar"), os.path.join(cache, "packages")
if not shutil.which("buildah"):
    skip("buildah is not installed")
if os.geteuid() != 0:
    skip("only root can build without a container engine")
if not os.path.exists(base) or not os.path.isdir(packages):
    skip("package_test has left no base and packages")

with tempfile.TemporaryDirectory() as folder:

    def buildah(*command, code=0):
        return run("buildah", "--root", folder + "/root", "--runroot", folder + "/run", "--storage-driver", "vfs", *command,
                   code=code)

    scratch = buildah("from", "scratch").strip()
    buildah("add", "--quiet", scratch, base, "/")
    buildah("commit", "--quiet", scratch, "docker.io/library/debian:12-slim")
    buildah("rm", scratch)
    buildah("bud", "--pull-never", "--isolation", "chroot", "--format", "docker", "--volume",
            os.path.join(cache, "archives") + ":/var/cache/apt/archives:rw", "--tag", "saltus", "--file",
            os.path.join(options.source, "deploy/oci/Containerfile"), packages)
    image = json.loads(buildah("inspect", "--type", "image", "saltus"))["Docker"]["config"]
    assert image["User"] == "990:990" and set(image["Volumes"]) == {"/var/lib/saltus", "/run/saltus"}, image
    check = image["Healthcheck"]["Test"]
    assert check[:3] == ["CMD", "saltus", "server"], check

    container = buildah("from", "--pull-never", "saltus").strip()
    place = ("run", "--isolation", "chroot", container, "--")
    buildah(*place, *check[1:], code=3)
    daemon = subprocess.Popen(
        ["buildah", "--root", folder + "/root", "--runroot", folder + "/run", "--storage-driver", "vfs", *place,
         *image["Entrypoint"], *image["Cmd"], "--exit-on-stdin-close"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    said = daemon.stdout.readline()
    assert said == "listening on unix:/run/saltus/saltusd.sock\n", said + daemon.communicate()[1]
    buildah(*place, *check[1:])
    buildah(*place, "sh", "-c", "cd /tmp && saltus phantom slip --size 40,40 --out pair && saltus register --server "
            "unix:/run/saltus/saltusd.sock --fixed pair/fixed.mha --moving pair/moving.mha --similarity ssd --preset fast "
            "--out result && test -s result/report.html && id -u | grep -x 990")
    daemon.stdin.close()
    assert daemon.wait(120) == 0, daemon.stderr.read()
    buildah("rm", container)
