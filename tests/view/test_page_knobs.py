"""Knobs of the page that were lost, refused in silence or without effect, with a server of synthetic data."""

from mock_page import FROZEN, WIDTH
from page import tone_value


def test_the_tone_of_this_moment_is_painted(mock_page):
    """A tone that changes while a frame is in flight is that of the frame."""
    page = mock_page(*FROZEN)
    page.click("one-to-one")
    x0, y0 = page.origin()
    page.mock.settings["delay"] = 0.5
    asked = len(page.log("/api/frame"))
    page.js("document.getElementById('next-frame').click()")
    page.wait(lambda: len(page.log("/api/frame")) > asked, "the request of the frame")
    page.set("tone", "log")
    page.settle()
    frame = page.frame()
    for x, y in [(10, 10), (160, 120), (300, 200)]:
        expected = tone_value(frame["values"][y * WIDTH + x], frame["header"], "log")
        assert page.pixel(x0 + x, y0 + y)[:3] == [expected] * 3, (x, y)
