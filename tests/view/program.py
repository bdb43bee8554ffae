"""The program `dunkelfeld`: its view as a server, and its commands."""

import http.client
import json
import os
import signal
import struct
import subprocess
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from page import PATIENCE, wait_for

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = Path(os.environ.get("DUNKELFELD", ROOT / "target" / "debug" / "dunkelfeld")).resolve()

TYPES = {"gray16": "<u2", "rgb8": "u1", "f32": "<f4"}


def attempt(*arguments, cwd):
    """Runs a command to its end."""
    command = [PROGRAM, *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300, check=False)


def run(*arguments, cwd, expected=0):
    """Runs a command that ends with this exit code."""
    found = attempt(*arguments, cwd=cwd)
    assert found.returncode == expected, (arguments, found.returncode, found.stderr)


class Refused(Exception):
    """An answer with a status of 400 or more."""

    def __init__(self, status, text):
        super().__init__(f"{status}: {text}")
        self.status = status
        self.text = text

    @property
    def fault(self):
        return json.loads(self.text)


class View:
    """A running `dunkelfeld view`."""

    def __init__(self, source, *arguments, folder):
        self.folder = Path(folder)
        self.messages = self.folder / "messages.txt"
        with self.messages.open("ab") as messages:
            self.process = subprocess.Popen(
                [PROGRAM, "view", "--no-open", *map(str, arguments), str(source)],
                cwd=folder,
                stdout=subprocess.PIPE,
                stderr=messages,
                text=True,
            )
        self.url = self.process.stdout.readline().strip()
        assert self.url.startswith("http://"), (self.url, self.messages.read_text())
        parts = urlsplit(self.url)
        self.host, self.port = parts.hostname, parts.port

    def request(self, method, path, body=None, headers=None):
        """Status, headers and body of an answer."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=PATIENCE)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    def state(self):
        status, _, body = self.request("GET", "/api/state")
        assert status == 200, (status, body)
        return json.loads(body)

    def ask(self, path, body):
        """The answer of a request with a body of JSON."""
        text = body if isinstance(body, (str, bytes)) else json.dumps(body)
        status, _, answer = self.request("POST", f"/api/{path}", text, {"content-type": "application/json"})
        if status >= 400:
            raise Refused(status, answer.decode())
        return answer

    def post(self, path, body):
        return json.loads(self.ask(path, body))

    def picture(self, path, body):
        """Header and values (rows, columns) of a frame or a map."""
        data = self.ask(path, body)
        (length,) = struct.unpack("<I", data[:4])
        header = json.loads(data[4 : 4 + length])
        values = np.frombuffer(data, TYPES[header["format"]], offset=(4 + length + 3) // 4 * 4)
        shape = (header["height"], header["width"]) + ((3,) if header["format"] == "rgb8" else ())
        return header, values.reshape(shape)

    def frame(self, frame=0, tone="gamma", exact=True, **changes):
        """A frame of the camera of the job with changes."""
        body = {"camera": self.camera(**changes), "frame": frame, "tone": tone, "exact": exact}
        return self.picture("frame", body)

    def camera(self, **changes):
        return {**self.state()["camera"], **changes}

    def wait(self, condition, what):
        """Waits until a condition on the state holds, and returns the state."""

        def met():
            assert self.process.poll() is None, self.text()
            state = self.state()
            return state if condition(state) else None

        return wait_for(met, what)

    def wait_for_film(self, spp=1.0):
        """Waits for a film without gaps that has so many samples per pixel. It is no picture before a change."""

        def is_there(state):
            film = state["film"]
            return film and not film["earlier"] and not film["first"] and film["spp"] >= spp

        return self.wait(is_there, f"{spp} spp")

    def pause(self):
        """Pauses the render, and returns the state of the pause."""
        self.post("render", {"action": "pause"})
        return self.wait(lambda state: state["render"]["state"] == "paused", "the pause")

    def text(self):
        """The messages of the program."""
        return self.messages.read_text()

    def interrupt(self):
        """Interrupts the program as Ctrl-C does, and returns its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(PATIENCE)
        finally:
            self.process.stdout.close()

    def kill(self):
        self.process.kill()
        self.process.wait(PATIENCE)
        self.process.stdout.close()

    def close(self):
        """Ends the program, which must not have panicked."""
        if self.process.poll() is None:
            self.interrupt()
        assert "panicked" not in self.text(), self.text()
