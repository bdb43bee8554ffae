"""The page with a server of synthetic data."""

import itertools
import threading

from mock_server import parse, serve
from page import Page

# The size of the synthetic film [pixels], and the second at which most tests hold its render.
WIDTH, HEIGHT = 320, 240
FROZEN = ["--freeze", "18.4"]


class MockPage(Page):
    """A server with synthetic data, and its page."""

    def __init__(self, driver, *arguments, **options):
        self.start(0, *arguments)
        super().__init__(driver, f"http://127.0.0.1:{self.port}/", **options)

    def start(self, port, *arguments):
        size = ["--width", str(WIDTH), "--height", str(HEIGHT)]
        self.mock, self.server = serve(parse(["--port", str(port), *size, *arguments]))
        self.port = self.server.server_address[1]
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()

    def stop(self):
        self.server.stopping = True
        self.server.shutdown()
        self.server.server_close()

    def origin(self, scale=1):
        return super().origin(WIDTH, HEIGHT, scale)

    def log(self, path=None):
        return [entry for entry in self.mock.log if path is None or entry["path"] == path]

    def last(self, path):
        return self.log(path)[-1]["body"]

    def camera(self):
        """The camera of the last frame that the page asked for."""
        return self.last("/api/frame")["camera"]

    def settle(self):
        """Waits until the page has the state of the server, and the picture of its knobs and film."""
        if self.mock.settings["frozen"] is not None:
            self.wait(lambda: self.is_up_to_date(), "the state of the server")
        self.idle()

    def is_up_to_date(self):
        state = self.state()
        return state["render"]["elapsed"] == self.mock.seconds() and state["target"] == self.mock.target

    def hold(self, seconds):
        """Holds the render at another second, and waits until the page shows it."""
        self.mock.settings["frozen"] = seconds
        self.settle()


def overlaps(entries):
    ordered = sorted(entries, key=lambda entry: entry["start"])
    return any(a["end"] is None or a["end"] > b["start"] + 0.002 for a, b in itertools.pairwise(ordered))
