"""Programs that were built with a released protocol must go on working: nothing of it may change or go.

released_protocol.txt has a line for each field, enum value and method of the last release, as they are on the wire. What
is new is free until the next release, which writes it down: protocol_test.py --write.
"""

import argparse
import os
import subprocess
import sys
import tempfile

try:
    from google.protobuf import descriptor_pb2
except ImportError as error:
    print(f"SKIPPED: {error}; install python3-protobuf")
    sys.exit(0)

parser = argparse.ArgumentParser()
parser.add_argument("--protoc", default="protoc")
parser.add_argument("--proto", required=True)
parser.add_argument("--released", required=True)
parser.add_argument("--write", action="store_true")
options = parser.parse_args()


def lines_of(file):
    """What two programs must agree on."""
    field = descriptor_pb2.FieldDescriptorProto

    def enum(prefix, described):
        for value in described.value:
            yield f"{prefix}.{described.name} {value.name} = {value.number}"

    def message(prefix, described):
        name = f"{prefix}.{described.name}"
        for one in described.field:
            kind = field.Type.Name(one.type) + (f" {one.type_name}" if one.type_name else "")
            yield f"{name} {field.Label.Name(one.label)} {kind} {one.name} = {one.number}"
        for nested in described.nested_type:
            yield from message(name, nested)
        for nested in described.enum_type:
            yield from enum(name, nested)

    for one in file.message_type:
        yield from message(file.package, one)
    for one in file.enum_type:
        yield from enum(file.package, one)
    for service in file.service:
        for method in service.method:
            streams = f"{'stream ' * method.client_streaming}{method.input_type}"
            answers = f"{'stream ' * method.server_streaming}{method.output_type}"
            yield f"/{file.package}.{service.name}/{method.name} ({streams}) returns ({answers})"


with tempfile.TemporaryDirectory() as folder:
    described = os.path.join(folder, "described")
    files = sorted(os.listdir(os.path.join(options.proto, "saltus/v1")))
    subprocess.run([options.protoc, "-I", options.proto, "--descriptor_set_out=" + described] +
                   [f"saltus/v1/{name}" for name in files if name.endswith(".proto")], check=True)
    with open(described, "rb") as opened:
        found = descriptor_pb2.FileDescriptorSet.FromString(opened.read())
now = sorted(line for file in found.file if file.package == "saltus.v1" for line in lines_of(file))

if options.write:
    with open(options.released, "w", encoding="ascii") as opened:
        opened.write("\n".join(now) + "\n")
    sys.exit(0)
with open(options.released, encoding="ascii") as opened:
    released = opened.read().splitlines()
assert len(released) > 100, "the released protocol is not there"
gone = sorted(set(released) - set(now))
if gone:
    sys.exit("These parts of the released protocol have changed or gone, which breaks clients and workers that are in "
             "use; add instead:\n  " + "\n  ".join(gone))
