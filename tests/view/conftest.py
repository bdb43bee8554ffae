"""The browser of all tests, and views that end with their test."""

import os
from pathlib import Path

import pytest
from jobs import station
from mock_page import MockPage
from page import Page
from program import ROOT, View
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

SCREENSHOTS = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "view-screenshots"


@pytest.fixture(scope="session")
def driver():
    options = webdriver.ChromeOptions()
    options.binary_location = os.environ.get("CHROMIUM", "/usr/bin/chromium")
    for argument in ["headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "disable-extensions"]:
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options, Service(os.environ.get("CHROMEDRIVER", "/usr/bin/chromedriver")))
    yield driver
    driver.quit()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Keeps a screenshot of the page at the end of each test of the browser."""
    report = yield
    if call.when == "call" and "driver" in item.funcargs:
        SCREENSHOTS.mkdir(parents=True, exist_ok=True)
        item.funcargs["driver"].save_screenshot(str(SCREENSHOTS / f"{item.path.stem}-{item.name}.png"))
    return report


@pytest.fixture
def view(tmp_path):
    """Starts views that end with the test: of a source, or of a job with this text."""
    started = []

    def start(source=None, *arguments, job=None):
        if source is None:
            source = tmp_path / "station.toml"
            source.write_text(job or station())
        started.append(View(source, *arguments, folder=tmp_path))
        return started[-1]

    yield start
    for running in started:
        running.close()


@pytest.fixture
def open_page(driver):
    """Opens the page of a view, and waits for its first picture."""

    def open_it(running, **options):
        page = Page(driver, running.url, **options)
        page.wait(lambda: page.frame() is not None, "the first picture")
        return page

    return open_it


@pytest.fixture
def mock_page(driver):
    """Opens the page of servers with synthetic data. The page must keep to the protocol, and write nothing to its console."""
    opened = []

    def open_it(*arguments, **options):
        opened.append(MockPage(driver, *arguments, **options))
        return opened[-1]

    yield open_it
    for page in opened:
        page.stop()
    for page in opened:
        # A restart of these renders removes the picture, which the page may ask for at the same time.
        page.assert_quiet_console(refusals=["409 ("])
        broken = [entry for entry in page.log() if entry.get("status") == 400]
        assert not broken, broken
