"""A server with synthetic data that follows docs/view-protocol.md, for tests of the page alone."""

import argparse
import json
import struct
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from mock_view import Fault, MockView

ASSETS = Path(__file__).resolve().parents[2] / "crates" / "apps" / "view" / "assets"
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".ts": "text/plain",
}


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    mock = None

    def handle(self):
        try:
            super().handle()
        except (BrokenPipeError, ConnectionResetError):
            pass  # The browser left the page.

    def log_message(self, *_):
        pass

    def send(self, status, kind, data):
        self.send_response(status)
        self.send_header("content-type", kind)
        self.send_header("content-length", str(len(data)))
        self.send_header("cache-control", "no-store")
        # As strict as a server may be: nothing from elsewhere, nothing inline.
        self.send_header("content-security-policy", "default-src 'self'; frame-ancestors 'none'")
        self.end_headers()
        self.wfile.write(data)

    def send_json(self, value, status=200):
        self.send(status, "application/json", json.dumps(value, allow_nan=False).encode())

    def do_GET(self):
        while self.path.startswith("/api/") and not self.path.startswith("/api/events") and self.mock.settings["mute"]:
            time.sleep(0.02)
        if self.path == "/api/state":
            return self.send_json(self.mock.state())
        if self.path == "/api/events":
            return self.events()
        name = "index.html" if self.path == "/" else self.path.removeprefix("/assets/")
        file = ASSETS / name
        if "/" in name or not file.is_file():
            return self.send_json({"problem": "There is no such page.", "place": self.path, "help": None}, 404)
        return self.send(200, TYPES.get(file.suffix, "application/octet-stream"), file.read_bytes())

    def events(self):
        self.send_response(200)
        self.send_header("content-type", "text/event-stream")
        self.send_header("cache-control", "no-store")
        self.end_headers()
        last = None
        self.mock.streams += 1
        try:
            while not self.server.stopping:
                self.mock.connected = True
                state = json.dumps(self.mock.state())
                if state != last and not self.mock.settings["mute"]:
                    self.wfile.write(f"event: state\ndata: {state}\n\n".encode())
                    self.wfile.flush()
                    last = state
                time.sleep(0.05)
        except OSError:
            pass
        self.mock.streams -= 1
        self.close_connection = True

    def do_POST(self):
        mock = self.mock
        body = json.loads(self.rfile.read(int(self.headers["content-length"])))
        entry = {"path": self.path, "body": body, "start": time.time(), "end": None}
        mock.log.append(entry)
        time.sleep(mock.settings["delay"])
        try:
            binary = {"/api/frame": mock.frame, "/api/map": mock.map}.get(self.path)
            answers = {
                "/api/probe": mock.probe,
                "/api/regions": mock.regions,
                "/api/line": mock.line,
                "/api/path": mock.path,
                "/api/photon-transfer": mock.photon_transfer,
                "/api/scene": mock.scene,
                "/api/render": mock.render,
                "/api/target": mock.set_target,
                "/api/save": mock.save,
            }
            if binary:
                header, data = binary(body)
                text = json.dumps(header).encode()
                pad = b"\0" * (-(4 + len(text)) % 4)
                entry["end"] = time.time()
                self.send(200, "application/octet-stream", struct.pack("<I", len(text)) + text + pad + data)
            else:
                result = answers[self.path](body)
                entry["end"] = time.time()
                self.send_json(result)
        except Fault as fault:
            entry["end"], entry["status"] = time.time(), fault.status
            self.send_json(fault.body, fault.status)
        except (KeyError, TypeError, ValueError) as error:
            entry["end"], entry["status"] = time.time(), 400
            self.send_json({"problem": f"The request is invalid: {error!r}", "place": self.path, "help": None}, 400)


class Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True
    stopping = False


def serve(options):
    mock = MockView(options)
    server = Server(("127.0.0.1", options.port), type("MockHandler", (Handler,), {"mock": mock}))
    return mock, server


def parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=8017)
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--height", type=int, default=480)
    parser.add_argument("--speed", type=float, default=1.0, help="render seconds in a second")
    parser.add_argument("--freeze", type=float, default=None, help="stop the render at this second")
    parser.add_argument("--mute", action="store_true", help="send no state until the setting `mute` is removed")
    parser.add_argument("--source", choices=["render", "film", "exr"], default="render")
    return parser.parse_args(arguments)
