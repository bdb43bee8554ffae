"""Figures of the live view: first picture, latency of the knobs, frames a second, and the cost to the render.

It starts the program on scenes/inspection/inspection.toml, with the page in a headless Chromium, and prints a table. With
`--pictures FOLDER` it also writes the screenshots of docs/view.md. Nothing else should run on the machine.

    pip install numpy pillow selenium
    DUNKELFELD=target/release/dunkelfeld python benches/view.py
"""

import argparse
import io
import json
import math
import statistics
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "view"))

from page import Page
from program import ROOT, View

SCENE = ROOT / "scenes" / "inspection"
# Changes of a knob.
CHANGES = 40
# Samples per pixel of the pictures.
PICTURE_SPP = 128
# The time from a change on the page to the painted picture with it. Without a change of the knobs there is no such picture.
CHANGE = """
const [id, value, done] = arguments;
const before = JSON.stringify(window.dunkelfeld.frame().camera);
const began = performance.now();
const control = document.getElementById(id);
if (control.type === "checkbox") control.click();
else {
  control.value = value;
  control.dispatchEvent(new Event("change", {bubbles: true}));
}
const look = () => {
  const isShown = JSON.stringify(window.dunkelfeld.frame().camera) !== before;
  if (isShown || performance.now() - began > 60000) requestAnimationFrame(() => done(performance.now() - began));
  else requestAnimationFrame(look);
};
look();
"""


def job(folder, width, height, name="inspection"):
    """A job of the inspection scene with another number of pixels."""
    text = (SCENE / f"{name}.toml").read_text()
    text = text.replace(f'"{name}.glb"', json.dumps(str(SCENE / f"{name}.glb")))
    changed = text.replace("width = 512", f"width = {width}").replace("height = 512", f"height = {height}")
    assert changed != text or (width, height) == (512, 512)
    path = Path(folder) / (f"{name}.toml" if (width, height) == (512, 512) else f"{name}-{width}x{height}.toml")
    path.write_text(changed)
    return path


def shown(driver, view):
    """The page of a view, with a picture."""
    page = Page(driver, view.url)
    page.wait(lambda: page.frame() is not None, "a picture")
    return page


def first_picture(folder):
    """Seconds from the end of the load to the first picture, and from the start of the program."""
    began = time.monotonic()
    view = View(job(folder, 512, 512), folder=folder)
    try:
        loaded = None
        while True:
            state = view.state()
            if loaded is None and state["render"]["state"] == "running":
                loaded = time.monotonic()
            if state["film"]:
                break
            time.sleep(0.002)
        view.frame()
        now = time.monotonic()
        return now - loaded, now - began
    finally:
        view.close()


def quantiles(values):
    """Median and 95 % quantile: the smallest value that 95 % of the values do not exceed."""
    values = sorted(values)
    return statistics.median(values), values[math.ceil(0.95 * len(values)) - 1]


def knobs(page, count, is_film, is_running):
    """Latencies [ms] of the knobs on the page: median and 95 %. Only a film of samples can be denoised.

    While a render runs there is always a newer film than that of the last analysis.
    """
    exposures = [("exposure-value", f"{3 + 0.1 * i:.1f} ms") for i in range(count)]
    devices = [("device", str(i + 11)) for i in range(count)]
    # Settings, the name of the knob, and its changes.
    changes = [
        ({}, "exposure", exposures),
        ({}, "gain", [("gain-value", f"{1.05 + 0.05 * i:.2f}") for i in range(count)]),
        ({}, "device", devices),
        ({}, "black level", [("black-level", str(10 + i)) for i in range(count)]),
        ({}, "sensor", [("sensor", ["imx174", "imx250"][i % 2]) for i in range(count)]),
        ({}, "noise: none, plain", [("noise", ["none", "plain"][i % 2]) for i in range(count)]),
        ({}, "noise: matched, plain", [("noise", ["matched", "plain"][i % 2]) for i in range(count)]),
        ({"noise": "matched"}, "device", devices),
        ({"noise": "matched"}, "exposure", exposures),
    ]
    if is_film:
        changes += [
            ({}, "denoiser: on, off", [("denoise", ["auto", "off"][i % 2]) for i in range(count)]),
            ({"denoise": "auto"}, "exposure", exposures),
        ]
    page.driver.set_script_timeout(120)
    found = {}
    for settings, name, steps in changes:
        for setting in settings.items():
            page.set(*setting)
        title = ", ".join([name, *(f"with {key} {value}" for key, value in settings.items())])
        found[title] = quantiles([page.driver.execute_async_script(CHANGE, *step) for step in steps])
        if settings and not is_running:
            began = time.monotonic()
            page.wait(lambda: page.js("return window.dunkelfeld.frame().header.analysis") == "exact", "the analysis")
            found[f"{title}: exact after the last change"] = (1e3 * (time.monotonic() - began),) * 2
        page.set("noise", "plain")
        page.set("denoise", "off")
    return found


def show_knobs(page, is_film=True, is_running=False):
    for name, (median, high) in knobs(page, CHANGES, is_film, is_running).items():
        print(f"  {name}: median {median:.0f} ms, 95 % {high:.0f} ms", flush=True)


def show_answers(view):
    """Time of the server to answer a knob, without a page."""
    camera = view.camera()
    for noise in ["plain", "matched"]:
        for knob, value in [("device", lambda i: i + 11), ("exposure", lambda i: 3e-3 + 1e-4 * i)]:
            times = []
            for i in range(20):
                began = time.monotonic()
                changed = {**camera, "noise": noise, knob: value(i)}
                view.picture("frame", {"camera": changed, "frame": 0, "tone": "gamma", "exact": False})
                times.append(1e3 * (time.monotonic() - began))
                time.sleep(0.05)
            print(
                f"  answer to {knob} with noise {noise}: median {statistics.median(times):.0f}, largest {max(times):.0f} ms"
            )


def show_first_changes(page):
    """Knobs that need an analysis, before the first analysis of a scene."""
    for knob, value, off in [("noise", "matched", "plain"), ("denoise", "auto", "off")]:
        latency = page.driver.execute_async_script(CHANGE, knob, value)
        readiness = page.js("return window.dunkelfeld.frame().header.analysis")
        began = time.monotonic()
        page.wait(lambda: page.js("return window.dunkelfeld.frame().header.analysis") != "none", "an analysis")
        seconds = time.monotonic() - began
        print(
            f"  first {knob} {value}: {latency:.0f} ms (analysis: {readiness}), with an analysis after {seconds:.1f} s"
        )
        page.set(knob, off)


def frame_rate(page, seconds):
    """Frames a second of the live view, as the page measures it."""
    page.js("document.getElementById('live').click()")
    time.sleep(seconds)
    rate = page.text("frame-rate")
    page.js("document.getElementById('live').click()")
    return float(rate.split()[0])


def samples_per_second(view, seconds):
    """Samples a second, from the progress of the render."""
    before = view.state()
    time.sleep(seconds)
    after = view.state()
    samples = after["film"]["samples"] - before["film"]["samples"]
    return samples / (after["film"]["seconds"] - before["film"]["seconds"])


def cost(folder, driver, rounds, seconds):
    """Samples a second with a page (still, live) over those without a page, in turns."""
    view = View(job(folder, 1024, 1024), folder=folder)
    try:
        view.wait_for_film(1)
        rates = {"none": [], "page": [], "live": []}
        for _ in range(rounds):
            driver.get("about:blank")
            time.sleep(1)
            rates["none"].append(samples_per_second(view, seconds))
            page = Page(driver, view.url)
            time.sleep(1)
            rates["page"].append(samples_per_second(view, seconds))
            page.js("document.getElementById('live').click()")
            time.sleep(1)
            rates["live"].append(samples_per_second(view, seconds))
        driver.get("about:blank")
        mean = {name: statistics.mean(values) for name, values in rates.items()}
        return {name: 1 - mean[name] / mean["none"] for name in ["page", "live"]}
    finally:
        view.close()


def screenshot(driver, file):
    """A screenshot with 256 colours."""
    picture = Image.open(io.BytesIO(driver.get_screenshot_as_png())).convert("RGB")
    picture.quantize(256, dither=Image.Dither.NONE).save(file, optimize=True)


def screenshots(folder, driver, target):
    """The pictures of docs/view.md: the scene without a cover, in which little noise is left after a minute."""
    view = View(job(folder, 512, 512, "inspection-open"), folder=folder)
    try:
        page = Page(driver, view.url)
        view.wait_for_film(PICTURE_SPP)
        page.idle()
        screenshot(driver, target / "view-camera.png")
        page.tab("noise")
        page.set("target", "2")
        page.set("map", "ratio")
        page.wait(lambda: page.state()["certificate"] is not None, "a certificate")
        page.idle()
        screenshot(driver, target / "view-noise.png")
        page.set("map", "none")
        page.set("target", "0.5")
        page.tab("measure")
        # A symbol, the panel beside it, and a line over both.
        page.set("region1", "246 324 266 344")
        page.set("region2", "290 324 310 344")
        page.set("line", "200 332 340 332")
        page.idle()
        screenshot(driver, target / "view-measure.png")
    finally:
        view.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pictures", type=Path, help="folder of the screenshots")
    parser.add_argument("--only-pictures", action="store_true")
    arguments = parser.parse_args()
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    for argument in ["headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage"]:
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options, Service("/usr/bin/chromedriver"))
    try:
        with tempfile.TemporaryDirectory() as folder:
            if arguments.pictures:
                screenshots(folder, driver, arguments.pictures)
            if arguments.only_pictures:
                return
            times = [first_picture(folder) for _ in range(7)]
            after_load, from_start = zip(*times, strict=True)
            print(f"first picture after the load, 512 x 512: median {statistics.median(after_load):.2f} s")
            print(
                f"  largest {max(after_load):.2f} s; from the start of the program {statistics.median(from_start):.2f} s"
            )
            for width, height in [(1024, 1024), (2592, 1944)]:
                view = View(job(folder, width, height), folder=folder)
                try:
                    print(f"{width} x {height}, at the beginning")
                    show_first_changes(shown(driver, view))
                    view.wait(lambda state: state["prepared"] >= 2, "the analyses")
                    for state in ["running", "paused"]:
                        if state == "paused":
                            view.pause()
                        page = shown(driver, view)
                        print(f"{width} x {height}, render {state}: live view {frame_rate(page, 8):.1f} frames/s")
                        if width == 1024:
                            show_knobs(page, is_running=state == "running")
                    if width == 1024:
                        driver.get("about:blank")
                        show_answers(view)
                        body = {"what": ["exr"], "name": "knobs", "camera": view.camera(), "frame": 0}
                        view.post("save", body)
                    driver.get("about:blank")
                finally:
                    view.close()
            view = View(Path(folder) / "knobs.exr", folder=folder)
            try:
                view.wait(lambda state: state["prepared"] >= 1, "the analysis")
                print("1024 x 1024, an EXR")
                show_knobs(shown(driver, view), is_film=False)
                driver.get("about:blank")
            finally:
                view.close()
            for name, share in cost(folder, driver, 5, 8).items():
                print(f"cost of a page to the render, 1024 x 1024, {name}: {100 * share:.1f} %")
    finally:
        driver.quit()


if __name__ == "__main__":
    main()
