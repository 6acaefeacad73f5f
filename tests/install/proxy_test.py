"""nginx before the daemon, with the configuration that we ship: who calls is still known, what is no TLS and who has too many
connections does not get through."""

import os
import shutil
import socket
import subprocess
import tempfile

from service import Daemon, arguments, run, skip

options = arguments()
saltus = os.path.join(options.programs, "saltus")
make = os.path.join(options.source, "deploy/operations/saltus-certificates")
nginx = shutil.which("nginx") or "/usr/sbin/nginx"
module = "/usr/lib/nginx/modules/ngx_stream_module.so"
if not os.path.exists(nginx) or not os.path.exists(module):
    skip("nginx with libnginx-mod-stream is not installed")


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


class Nginx:

    def __init__(self, folder, upstream):
        self.port = free_port()
        with open(os.path.join(options.source, "deploy/proxy/nginx-stream.conf"), encoding="utf-8") as file:
            shipped = file.read()
        assert "127.0.0.1:50051" in shipped and "listen 50052;" in shipped
        configuration = os.path.join(folder, "nginx.conf")
        with open(configuration, "w", encoding="utf-8") as file:
            file.write(f"load_module {module};\nuser root;\npid {folder}/nginx.pid;\nerror_log stderr;\nevents {{}}\n" +
                       shipped.replace("127.0.0.1:50051", upstream).replace(
                           "listen 50052;", f"listen 127.0.0.1:{self.port};"))
        run(nginx, "-t", "-c", configuration, "-p", folder)
        # Its sockets listen before it says that it has begun.
        self._process = subprocess.Popen([nginx, "-c", configuration, "-p", folder, "-g", "daemon off;"],
                                         stderr=subprocess.PIPE, text=True)

    def __enter__(self):
        while True:
            try:
                self.connect().close()
                return self
            except ConnectionRefusedError:
                assert self._process.poll() is None, self._process.communicate()[1]

    def __exit__(self, *_):
        self._process.terminate()
        self._process.communicate(timeout=60)

    def connect(self):
        connection = socket.create_connection(("127.0.0.1", self.port))
        connection.settimeout(60)
        return connection


def is_closed(connection):
    """Waits until the other side has answered or gone."""
    try:
        return connection.recv(1) == b""
    except ConnectionResetError:
        return True


with tempfile.TemporaryDirectory() as folder:
    made = os.path.join(folder, "certificates")
    run(make, "server", made, "localhost", "127.0.0.1")
    roles = os.path.join(folder, "roles")
    with open(roles, "w", encoding="ascii") as file:
        for who, role in (("meier", "submitter"), ("huber", "submitter"), ("node", "worker")):
            run(make, "client", made, f"{who}@hospital.example")
            file.write(f"{who}@hospital.example = {role}\n")
    pair = os.path.join(folder, "pair")
    run(saltus, "phantom", "slip", "--size", "40,40", "--out", pair)

    with Daemon(options, os.path.join(folder, "data"), "--listen", "127.0.0.1:0", "--tls-cert", made + "/server.crt",
                "--tls-key", made + "/server.key", "--tls-client-ca", made + "/authority.crt", "--roles", roles) as daemon:
        with Nginx(folder, daemon.next_address()) as proxy:

            def call(who, *command, code=0):
                return run(saltus, *command, "--server", f"127.0.0.1:{proxy.port}", "--tls-ca", made + "/authority.crt",
                           "--tls-cert", f"{made}/clients/{who}@hospital.example.crt", "--tls-key",
                           f"{made}/clients/{who}@hospital.example.key", code=code)

            call("meier", "register", "--fixed", pair + "/fixed.mha", "--moving", pair + "/moving.mha", "--similarity",
                 "ssd", "--preset", "fast", "--out", os.path.join(folder, "result"))
            assert os.path.getsize(os.path.join(folder, "result/report.html")) > 0
            assert "SUCCEEDED" in call("meier", "list")
            assert "SUCCEEDED" not in call("huber", "list"), "one submitter is taken for another"
            call("node", "list", code=1)

            with proxy.connect() as connection:
                connection.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(9))
                assert is_closed(connection), "what is no TLS gets through"

            idle = [proxy.connect() for _ in range(32)]
            with proxy.connect() as connection:
                assert is_closed(connection), "a 33rd connection gets through"
            for connection in idle:
                connection.close()
