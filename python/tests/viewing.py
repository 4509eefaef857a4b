"""`omniwalk view` as the tests use it: a process, its addresses, its requests and its socket."""

import json
import signal
import struct
import subprocess
import time
import urllib.request
from contextlib import contextmanager
from urllib.parse import parse_qs, urlsplit

from websockets.sync.client import connect

from programs import ROOT, program

POLICY = ROOT / "runs" / "nimbro_op2x_omni" / "policy.omni"


class View:
    """A running `omniwalk view`."""

    def __init__(self, address: str, foxglove: str | None):
        self.address, self.foxglove = address, foxglove
        parts = urlsplit(address)
        self.host, self.port = parts.hostname, parts.port
        (self.token,) = parse_qs(parts.query)["token"]

    def url(self, path: str, scheme: str = "http") -> str:
        return f"{scheme}://{self.host}:{self.port}/api/{path}?token={self.token}"

    def get(self, path: str) -> bytes:
        with urllib.request.urlopen(self.url(path), timeout=60) as response:
            return response.read()

    def json(self, path: str):
        return json.loads(self.get(path))

    def rows(self, index: int) -> list[dict[str, float]]:
        """The moments of log `index`, each by the names of its numbers."""
        fields, data = self.json("robot")["fields"], self.get(f"clips/{index}")
        return [dict(zip(fields, row)) for row in struct.iter_unpack(f"<{len(fields)}f", data)]

    def drive(self) -> "Drive":
        return Drive(self)


class Drive:
    """The socket of the robot that walks."""

    def __init__(self, view: View):
        self.fields = view.json("robot")["fields"]
        self.connection = connect(view.url("drive", "ws"))

    def __enter__(self):
        self.socket = self.connection.__enter__()
        self.limits = json.loads(self.socket.recv(timeout=60))["limits"]
        return self

    def __exit__(self, *error):
        return self.connection.__exit__(*error)

    def send(self, kind: str, **order):
        self.socket.send(json.dumps({"type": kind, **order}))

    def next(self, kind: str, holds=lambda _: True, seconds: float = 60.0):
        """The next row, report or error that is as it should be."""
        end = time.monotonic() + seconds
        while True:
            message = self.socket.recv(timeout=max(0.01, end - time.monotonic()))
            if isinstance(message, bytes):
                found, value = "row", dict(zip(self.fields, struct.unpack(f"<{len(self.fields)}f", message)))
            else:
                value = json.loads(message)
                found = value["type"]
            if found == kind and holds(value):
                return value

    def walk(self, velocity, seconds: float) -> dict[str, float]:
        """Walks for so long in the robot's time; the last row."""
        row = first = self.next("row")
        while row["time"] < first["time"] + seconds:
            self.send("walk", velocity=velocity)
            time = row["time"]
            row = self.next("row", lambda row: row["time"] >= time + 0.1)
        return row


@contextmanager
def viewing(*arguments):
    """Runs `omniwalk view` on ports that are free; ends it as Ctrl-C does, and expects that it ends well."""
    command = [*program("omniwalk"), "view", *map(str, arguments), "--listen", "127.0.0.1:0", "--foxglove-port", "0"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    try:
        opened = process.stdout.readline()
        assert opened.startswith("open http://127.0.0.1:"), opened
        robot = json.loads(View(opened.split()[1], None).get("robot"))
        foxglove = process.stdout.readline().split()[1] if robot["drives"] else None
        yield View(opened.split()[1], foxglove)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0
    finally:
        process.kill()
        process.wait()
