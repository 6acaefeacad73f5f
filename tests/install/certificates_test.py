"""The certificates that saltus-certificates makes are what daemon and client take: as the runbook says it."""

import os
import tempfile

from service import Daemon, arguments, run

options = arguments()
saltus = os.path.join(options.programs, "saltus")
make = os.path.join(options.source, "deploy/operations/saltus-certificates")

with tempfile.TemporaryDirectory() as folder:
    made = os.path.join(folder, "certificates")
    run(make, "server", made, "localhost", "127.0.0.1")
    for who in ("dr.meier@hospital.example", "worker-1.hospital.example", "stranger@hospital.example"):
        run(make, "client", made, who)
    for secret in ("authority.key", "server.key", "clients/dr.meier@hospital.example.key"):
        assert os.stat(os.path.join(made, secret)).st_mode & 0o077 == 0, secret
    assert "is there already" in run(make, "server", made, "localhost", code=1)
    assert "cannot be read" in run(make, "client", os.path.join(folder, "none"), "a@b", code=1)
    assert "usage" in run(make, code=2)
    assert "no name" in run(make, "client", made, "a b", code=2)
    assert "no name" in run(make, "client", made, "a,email:root", code=2)

    roles = os.path.join(folder, "roles")
    with open(roles, "w", encoding="ascii") as file:
        file.write("dr.meier@hospital.example = submitter\nworker-1.hospital.example = worker\n")
    with Daemon(options, os.path.join(folder, "data"), "--listen", "127.0.0.1:0", "--tls-cert", made + "/server.crt",
                "--tls-key", made + "/server.key", "--tls-client-ca", made + "/authority.crt", "--roles", roles) as daemon:
        address = daemon.next_address()

        def call(who, *command, code=0, server=address):
            return run(saltus, *command, "--server", server, "--tls-ca", made + "/authority.crt", "--tls-cert",
                       f"{made}/clients/{who}.crt", "--tls-key", f"{made}/clients/{who}.key", code=code)

        call("dr.meier@hospital.example", "list")
        call("dr.meier@hospital.example", "list", server=address.replace("127.0.0.1", "localhost"))
        call("worker-1.hospital.example", "list", code=1)
        call("stranger@hospital.example", "list", code=1)
        # One who has another authority's certificate is not heard at all.
        other = os.path.join(folder, "other")
        run(make, "server", other, "localhost")
        run(make, "client", other, "dr.meier@hospital.example")
        run(saltus, "list", "--server", address, "--tls-ca", made + "/authority.crt", "--tls-cert",
            other + "/clients/dr.meier@hospital.example.crt", "--tls-key",
            other + "/clients/dr.meier@hospital.example.key", code=3)
