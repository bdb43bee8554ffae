"""The page of `dunkelfeld view` in a browser: controls by their ids, and the state that the page publishes for tests."""

import math
import time

from selenium.webdriver.common.action_chains import ActionChains

# A condition that is not met after this time is a failure. It is several times the time that a slow machine needs.
PATIENCE = 120.0

# Marks of requests that the server refuses: the browser itself writes them to its console.
REFUSALS = ("400 (", "403 (", "409 (", "422 (")


def wait_for(condition, what, seconds=PATIENCE):
    """Waits until a condition holds, and returns its value."""
    end = time.monotonic() + seconds
    while True:
        found = condition()
        if found:
            return found
        assert time.monotonic() < end, f"waited {seconds} s for: {what}"
        time.sleep(0.03)


def tone_value(value, header, tone):
    """The value of the screen of a grey value: the black level is black."""
    share = min(1, max(0, (value - header["black"]) / (header["white"] - header["black"])))
    if tone == "gamma":
        return round(255 * share ** (1 / 2.2))
    return round(255 * share) if tone == "linear" else round(255 * math.log(1 + 1000 * share) / math.log(1001))


class Page:
    """The page of a server in the browser of the tests."""

    def __init__(self, driver, url, width=1280, height=720, dark=False):
        self.driver = driver
        self.url = url
        self.size(width, height, dark)
        driver.get("about:blank")
        driver.get_log("browser")
        self.load()

    def load(self):
        self.driver.get(self.url)
        self.wait(lambda: self.js("return window.dunkelfeld?.state != null"), "the state of the server")
        self.idle()

    def refresh(self):
        self.driver.refresh()
        self.wait(lambda: self.js("return window.dunkelfeld?.state != null"), "the state of the server")
        self.idle()

    def size(self, width, height, dark=False):
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})

    def js(self, script, *arguments):
        return self.driver.execute_script(script, *arguments)

    def idle(self):
        """Waits until no request is in flight, no debounced change waits, and the canvas is painted.

        The live view requests a frame every 100 ms. If a frame takes longer, a request is always in flight, so only
        the paint is waited for.
        """
        self.driver.set_script_timeout(PATIENCE)
        self.driver.execute_async_script(
            "const done = arguments[0];"
            "const live = document.getElementById('live').getAttribute('aria-pressed') === 'true';"
            "const ready = live ? Promise.resolve() : window.dunkelfeld.idle();"
            "ready.then(() => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )

    def wait(self, condition, what="condition", seconds=PATIENCE):
        return wait_for(condition, what, seconds)

    def element(self, id_):
        return self.driver.find_element("id", id_)

    def attribute(self, id_, name):
        return self.js("return document.getElementById(arguments[0]).getAttribute(arguments[1])", id_, name)

    def text(self, id_):
        return self.js("return document.getElementById(arguments[0]).textContent", id_)

    def value(self, id_):
        return self.js("return document.getElementById(arguments[0]).value", id_)

    def checked(self, id_):
        return self.js("return document.getElementById(arguments[0]).checked", id_)

    def hidden(self, id_):
        return self.js("return document.getElementById(arguments[0]).hidden", id_)

    def disabled(self, id_):
        return self.js("return document.getElementById(arguments[0]).disabled", id_)

    def set(self, id_, value, event="change"):
        self.js(
            "const e = document.getElementById(arguments[0]); e.value = arguments[1];"
            "e.dispatchEvent(new Event(arguments[2], {bubbles: true}))",
            id_,
            str(value),
            event,
        )
        self.idle()

    def click(self, id_):
        self.js("document.getElementById(arguments[0]).click()", id_)
        self.idle()

    def tab(self, name):
        self.click(f"tab-{name}")

    def keys(self, *keys, focus="image"):
        if focus:
            self.js("document.getElementById(arguments[0]).focus()", focus)
        ActionChains(self.driver).send_keys(*keys).perform()
        self.idle()

    def chord(self, modifier, key):
        self.js("document.getElementById('image').focus()")
        ActionChains(self.driver).key_down(modifier).send_keys(key).key_up(modifier).perform()
        self.idle()

    def canvas(self):
        return self.js(
            "const r = document.getElementById('image').getBoundingClientRect();"
            "return [r.left, r.top, r.width, r.height]"
        )

    def mouse(self, *points, drag=False):
        """Moves over points of the canvas (CSS pixels from its corner), with the button down if drag."""
        left, top, _, _ = self.canvas()
        actions = ActionChains(self.driver, duration=20)
        pointer = actions.w3c_actions.pointer_action
        for index, (x, y) in enumerate(points):
            pointer.move_to_location(int(left + x), int(top + y))
            if drag and index == 0:
                pointer.pointer_down()
        if drag:
            pointer.pointer_up()
        actions.perform()
        self.idle()

    def pixel(self, x, y):
        """RGBA of a pixel of the canvas."""
        return self.pixels(x, y, 1, 1)[0]

    def pixels(self, x, y, width, height):
        """RGBA of a rectangle of the canvas, row by row."""
        data = self.js(
            "const c = document.createElement('canvas'); [c.width, c.height] = "
            "[arguments[2], arguments[3]];"
            "const p = c.getContext('2d', {willReadFrequently: true});"
            "p.drawImage(document.getElementById('image'), -arguments[0], -arguments[1]);"
            "return [...p.getImageData(0, 0, arguments[2], arguments[3]).data]",
            int(x),
            int(y),
            int(width),
            int(height),
        )
        return [data[i : i + 4] for i in range(0, len(data), 4)]

    def origin(self, width, height, scale=1):
        """The place on the canvas of the corner of a film that is in its middle."""
        _, _, view_width, view_height = self.canvas()
        return (
            math.floor((view_width - width * scale) / 2 + 0.5),
            math.floor((view_height - height * scale) / 2 + 0.5),
        )

    def state(self):
        return self.js("return window.dunkelfeld.state")

    def frame(self):
        """Header and values of the picture A, or None."""
        return self.js("const f = window.dunkelfeld.frame(); return f && {header: f.header, values: [...f.values]}")

    def film(self):
        """The id of the film of the picture A, or None."""
        return self.js("return window.dunkelfeld.frame()?.header.film ?? null")

    def console(self):
        return [entry for entry in self.driver.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]

    def assert_quiet_console(self, refusals=()):
        """No error or warning, except those of requests that the server has refused: True for all, or marks of some."""
        marks = REFUSALS if refusals is True else refusals
        messages = [entry["message"] for entry in self.console()]
        messages = [text for text in messages if not any(mark in text for mark in marks)]
        assert not messages, messages
