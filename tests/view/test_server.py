"""The server against requests of other pages, broken ones, clients that read nothing, and signals."""

import contextlib
import itertools
import json
import math
import os
import re
import resource
import signal
import socket
import subprocess
import time
from pathlib import Path

import pytest
from jobs import station
from page import PATIENCE, Page, wait_for
from program import PROGRAM, Refused, View

SMALL = station(width=64, height=48)


def raw(running, data, end=False):
    """The status of the answer to these bytes, or 0 if the server closes the connection without one.

    With `end` the client sends nothing more, which the server would otherwise wait for.
    """
    with socket.create_connection((running.host, running.port), PATIENCE) as connection:
        with contextlib.suppress(OSError):
            connection.sendall(data)
            if end:
                connection.shutdown(socket.SHUT_WR)
        answer = b""
        with contextlib.suppress(OSError):
            while chunk := connection.recv(65536):
                answer += chunk
    found = re.match(rb"HTTP/1\.[01] (\d{3}) ", answer)
    return int(found[1]) if found else 0


def request(method, path, *headers, body=b"", host="127.0.0.1"):
    """The bytes of a request. `%` is the port of the server."""
    lines = [f"{method} {path} HTTP/1.1", f"Host: {host}", "Connection: close", *headers]
    if body:
        lines.append(f"Content-Length: {len(body)}")
    return ("\r\n".join(lines) + "\r\n\r\n").encode("latin-1") + body


@pytest.fixture
def running(view):
    started = view(job=SMALL)
    started.wait_for_film(1)
    return started


def test_foreign_pages_are_refused(running):
    own = f"127.0.0.1:{running.port}"
    json_type = "Content-Type: application/json"
    body = b'{"action": "pause"}'

    def status(*headers, method="GET", path="/api/state", host=own, body=b""):
        return raw(running, request(method, path, *headers, host=host, body=body))

    assert status() == 200 and status(host=f"localhost:{running.port}") == 200
    assert status(f"Origin: http://{own}") == 200
    for host in ["evil.example", f"evil.example:{running.port}", "127.0.0.1", "127.0.0.1:1", f"127.0.0.1.evil:{running.port}",
                 f"{own}@evil.example", "", "[::1]"]:  # fmt: skip
        assert status(host=host) in (400, 403), host
        assert status(json_type, host=host, method="POST", path="/api/render", body=body) in (400, 403), host
    for origin in [
        "http://evil.example",
        f"https://{own}",
        f"http://{own}.evil.example",
        "null",
        "http://127.0.0.1:1",
        "",
    ]:
        assert status(f"Origin: {origin}") == 403, origin
        refused = status(f"Origin: {origin}", json_type, method="POST", path="/api/render", body=body)
        assert refused == 403, origin
    assert status("Sec-Fetch-Site: cross-site") == 403
    # Forms and simple requests of other pages have these types, or none.
    kinds = [
        "application/x-www-form-urlencoded",
        "multipart/form-data; boundary=x",
        "text/plain",
        "",
        "application/jsonp",
    ]
    for kind in kinds:
        assert status(f"Content-Type: {kind}", method="POST", path="/api/render", body=body) == 403, kind
    assert status(method="POST", path="/api/render", body=body) == 403
    # Two hosts, of which one is right.
    two = f"GET /api/state HTTP/1.1\r\nHost: {own}\r\nHost: evil.example\r\nConnection: close\r\n\r\n".encode()
    assert raw(running, two) in (200, 400, 403)
    absolute = b"GET http://evil.example/api/state HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n"
    assert raw(running, absolute) in (400, 403)
    assert running.state()["render"]["state"] == "running", "no foreign page paused the render"


def test_headers_of_security(running):
    for path in ["/", "/assets/main.js", "/api/state", "/nothing"]:
        _, headers, _ = running.request("GET", path)
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff" and headers["x-frame-options"] == "DENY"
        assert headers["cache-control"] == "no-store" and headers["access-control-allow-origin"] is None


def test_paths_and_methods(running):
    own = f"127.0.0.1:{running.port}"
    paths = ["/nothing", "/api", "/api/", "/api/nothing", "/assets/", "/assets/..", "/assets/../Cargo.toml",
             "/assets/%2e%2e/Cargo.toml", "/assets/%2e%2e%2fCargo.toml", "/assets/..%2f..%2fCargo.toml", "/../../etc/passwd",
             "/assets//etc/passwd", "/assets/protocol.d.ts", "/station.toml", "/assets/%00", "/assets/main.js/", "//",
             "/assets/%ff", "/" + "a" * 5000]  # fmt: skip
    for path in paths:
        assert 400 <= raw(running, request("GET", path, host=own)) < 500, path
    json_type = "Content-Type: application/json"
    for method, path in [("POST", "/"), ("PUT", "/api/state"), ("GET", "/api/frame"), ("DELETE", "/api/scene"),
                         ("POST", "/api/events"), ("TRACE", "/"), ("CONNECT", own), ("OPTIONS", "/api/save")]:  # fmt: skip
        assert 400 <= raw(running, request(method, path, json_type, host=own, body=b"{}")) < 500, (method, path)


def test_broken_requests(running):
    own = f"127.0.0.1:{running.port}"
    head = f"POST /api/frame HTTP/1.1\r\nHost: {own}\r\nContent-Type: application/json\r\n"
    broken = [
        b"\r\n\r\n", b"GET\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"\x00" * 1000, b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost 1\r\n\r\n", b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 1000 + b"\r\n",
        b"GET / HTTP/1.1\r\nA: " + b"b" * 1_000_000 + b"\r\n\r\n",
        (head + "Content-Length: -1\r\n\r\n").encode(), (head + "Content-Length: 99999999999999999999\r\n\r\n").encode(),
        (head + "Content-Length: 5\r\nContent-Length: 6\r\n\r\n{}").encode(), (head + "Content-Length: 50\r\n\r\n{").encode(),
        (head + "Transfer-Encoding: chunked\r\n\r\nZZ\r\n{}\r\n0\r\n\r\n").encode(),
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    ]  # fmt: skip
    for data in broken:
        status = raw(running, data, end=True)
        assert status == 0 or 400 <= status < 600, data[:60]
        assert status not in (500, 200), data[:60]
    # Bodies beyond the limit: with a length, and in chunks.
    large = b'{"camera": "' + b"x" * 200_000 + b'"}'
    assert raw(running, request("POST", "/api/frame", "Content-Type: application/json", host=own, body=large)) in (
        0,
        413,
    )
    chunks = b"".join(b"1000\r\n" + b" " * 4096 + b"\r\n" for _ in range(64)) + b"0\r\n\r\n"
    chunked = (head + "Connection: close\r\nTransfer-Encoding: chunked\r\n\r\n").encode() + chunks
    assert raw(running, chunked) in (0, 413)
    assert running.state()["film"]


def bodies(running):
    """A valid body of each request about a picture or the scene."""
    camera = running.camera()
    shot = {"camera": camera, "frame": 0}
    return {
        "frame": {**shot, "tone": "gamma"},
        "map": {"camera": camera, "map": "samples"},
        "probe": {**shot, "x": 1, "y": 2},
        "regions": {**shot, "regions": [[1, 2, 30, 40]]},
        "line": {**shot, "from": [0, 0], "to": [20, 10]},
        "path": {"x": 1, "y": 2, "index": 0, "camera": camera},
        "photon-transfer": {"camera": camera},
        "scene": {"lights": {"left": {"on": True, "factor": 1}}, "materials": {"lid": {"roughness": 0.5}}},
        "target": {"k": 0.5},
        "render": {"action": "resume"},
        "save": {**shot, "what": ["png"], "name": "fuzz"},
    }


def places(body, path=()):
    """The places of all values in a body."""
    yield path
    entries = body.items() if isinstance(body, dict) else enumerate(body) if isinstance(body, list) else ()
    for key, value in entries:
        yield from places(value, (*path, key))


def replaced(body, path, value):
    if not path:
        return value
    copy = dict(body) if isinstance(body, dict) else list(body)
    copy[path[0]] = replaced(body[path[0]], path[1:], value)
    return copy


# Values that no request should have: some become valid at some places, none may do harm.
ODD = [None, True, -1, 0, 1e308, -1e308, 5e-324, 2**64, 2**63, -(2**63) - 1, 4294967295, 1.5, "", "x", "\u0000", [], {}, [[]],
       [0] * 5, "../x", math.nan, math.inf]  # fmt: skip


def test_odd_values_in_each_request(running):
    """Each value of each request is replaced by odd ones: an answer is 200 or a fault with its text, and nothing panics."""
    answered = 0
    for path, body in bodies(running).items():
        for place, value in itertools.product(places(body), ODD):
            if path == "scene" and place == () and value == {}:
                continue
            try:
                running.ask(path, json.dumps(replaced(body, place, value)))
                answered += 1
            except Refused as refusal:
                # The changes of the scene among the requests make the picture one of an earlier scene.
                assert refusal.status in (400, 409, 413, 415, 422), (path, place, value, str(refusal))
                fault = refusal.fault
                assert fault["problem"] and fault["problem"] != "the computation has failed", (path, place, value)
    assert answered > 0
    for path, body in bodies(running).items():
        if path not in ("render",):
            with pytest.raises(Refused) as refusal:
                running.post(path, {**body, "more": 1})
            assert refusal.value.status in (400, 422), path
        for text in [
            "",
            "{",
            "[]",
            "null",
            '{"a": 1e999}',
            "[" * 40_000,
            '{"k": NaN}',
            b"\xef\xbb\xbf{}",
            b"\xff\xfe{}",
        ]:
            # All keys of a change of the scene may be left out, also those of a list.
            if path == "scene" and text == "[]":
                continue
            with pytest.raises(Refused) as refusal:
                running.ask(path, text)
            assert refusal.value.status in (400, 422), (path, text[:20])
    assert "panicked" not in running.text()
    # The view works as before.
    running.post("render", {"action": "restart"})
    running.wait(lambda state: state["render"]["state"] == "running" and state["error"] is None, "a render")
    running.frame()


def test_a_token_where_others_can_connect(view, driver):
    running = view(None, "--listen", "0.0.0.0:0", job=SMALL)
    token = re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=([0-9a-f]{32})", running.url)[1]
    # The address for other computers, if this one is in a network.
    for found in re.findall(r"http://\S+", running.text()):
        assert re.fullmatch(rf"http://[\d.]+:{running.port}/\?token={token}", found) and "0.0.0.0" not in found
    assert running.request("GET", "/")[0] == 403 and running.request("GET", "/api/state")[0] == 403
    assert running.request("GET", "/assets/main.js")[0] == 403
    assert running.request("GET", f"/?token={'0' * 32}")[0] == 403
    assert running.request("GET", f"/api/state?token={token}")[0] == 403, "the token of the address opens the page only"
    status, headers, _ = running.request("GET", f"/?token={token}")
    assert status == 200 and "HttpOnly" in headers["set-cookie"] and "SameSite=Strict" in headers["set-cookie"]
    assert running.request("GET", "/api/state", headers={"cookie": f"dunkelfeld-view-{running.port}={token}"})[0] == 200
    page = Page(driver, f"http://127.0.0.1:{running.port}/?token={token}")
    page.wait(lambda: page.frame() is not None, "the first picture")
    page.assert_quiet_console()
    driver.delete_all_cookies()


def test_two_views_with_tokens_in_one_browser(view, driver, tmp_path):
    """Browsers send the cookies of a host to all of its ports: the second view must not lock the first one out."""
    (tmp_path / "small.toml").write_text(SMALL)
    views = [view(tmp_path / "small.toml", "--listen", "0.0.0.0:0") for _ in range(2)]
    for running in views:
        page = Page(driver, running.url)
        page.wait(lambda page=page: page.frame() is not None, "the first picture")
    driver.get(f"http://127.0.0.1:{views[0].port}/")
    page.wait(lambda: page.frame() is not None, "the picture of the first view")
    page.console()
    driver.delete_all_cookies()


def test_the_browser_of_the_desktop(tmp_path):
    """It gets the token by a private file, and is not ended by Ctrl-C in the terminal."""
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "bin").mkdir()
    browser = tmp_path / "bin" / "xdg-open"
    browser.write_text(f'#!/bin/sh\ntrap "touch {tmp_path}/interrupted" INT\ncp "$1" {tmp_path}/page.html\n'
                       f'echo "$1" > {tmp_path}/opened.tmp\nmv {tmp_path}/opened.tmp {tmp_path}/opened\nsleep 20\n')  # fmt: skip
    browser.chmod(0o755)
    environment = {**os.environ, "DISPLAY": ":9", "PATH": f"{tmp_path}/bin:{os.environ['PATH']}"}
    process = subprocess.Popen([PROGRAM, "view", "--listen", "0.0.0.0:0", "small.toml"], cwd=tmp_path, env=environment,
                               stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True)  # fmt: skip
    try:
        address = process.stdout.readline().strip()
        token = address.split("token=")[1]
        wait_for(lambda: (tmp_path / "opened").exists(), "the browser")
        file = Path((tmp_path / "opened").read_text().strip())
        assert token not in str(file) and address in (tmp_path / "page.html").read_text()
        assert file.stat().st_mode & 0o777 == 0o600 and file.parent.stat().st_mode & 0o777 == 0o700
        # As the terminal does: to the group of the program.
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(PATIENCE) == 130
        assert not file.exists() and not file.parent.exists() and not (tmp_path / "interrupted").exists()
    finally:
        process.stdout.close()
        process.kill()
        process.wait()


def test_half_requests_are_closed(running):
    """Nothing at all, half a head, and a body that stops: the server ends them by itself."""
    head = f"POST /api/frame HTTP/1.1\r\nHost: 127.0.0.1:{running.port}\r\nContent-Type: application/json\r\n"
    for data in [b"", head.encode(), f"{head}Content-Length: 9\r\n\r\n{{".encode()]:
        assert raw(running, data) in (0, 408)
    running.frame()


def memory(running):
    """Resident memory of the program [bytes]."""
    text = (f"/proc/{running.process.pid}/status",)
    with open(*text) as file:
        return 1024 * int(re.search(r"VmRSS:\s+(\d+) kB", file.read())[1])


def test_clients_that_read_nothing(running, open_page):
    """Connections that send nothing, event streams and pictures that nobody reads: the render goes on, the page answers."""
    page = open_page(running)
    own = f"127.0.0.1:{running.port}"
    shot = json.dumps({"camera": running.camera(), "frame": 0, "tone": "gamma"}).encode()
    before = memory(running)
    with contextlib.ExitStack() as stack:

        def connect(data):
            connection = stack.enter_context(socket.create_connection((running.host, running.port), PATIENCE))
            connection.sendall(data)
            return connection

        for _ in range(100):
            connect(b"")
        for _ in range(100):
            connect(b"POST /api/frame HTTP/1.1\r\nHost:")
        streams = [connect(request("GET", "/api/events", host=own)) for _ in range(100)]
        for _ in range(100):
            connect(request("POST", "/api/frame", "Content-Type: application/json", host=own, body=shot) * 4)
        start = running.state()["film"]
        state = running.wait(lambda state: state["film"]["id"] >= start["id"] + 3, "films beside the clients")
        assert state["film"]["samples"] > start["samples"]
        page.wait(lambda: page.film() >= start["id"] + 3, "pictures beside the clients")
        # A slow reader gets whole events, the newest state among them.
        slow = streams[0].makefile("rb")
        assert b"200" in slow.readline()
        wait_for(lambda: slow.readline().startswith(b"data: {"), "an event")
        running.frame()
        # 4 pictures of 6 KB for each of 100 clients, states of about 10 KB, and buffers.
        assert memory(running) - before < 200e6
    page.assert_quiet_console()


def test_connections_beyond_the_limit_of_files(view, tmp_path):
    """More connections than the process can have files: it does not end, and answers when they are gone."""
    running = view(job=SMALL)
    running.wait_for_film(1)
    resource.prlimit(running.process.pid, resource.RLIMIT_NOFILE, (64, 64))
    with contextlib.ExitStack() as stack:
        for _ in range(150):
            connection = stack.enter_context(socket.socket())
            connection.settimeout(PATIENCE)
            connection.connect((running.host, running.port))
    running.wait(lambda state: state["film"]["spp"] > 2, "samples")


def test_the_page_connects_again_to_a_new_server(view, tmp_path, open_page):
    running = view(job=SMALL)
    page = open_page(running)
    running.kill()
    page.wait(lambda: page.text("connection") == "disconnected: reconnecting", "the lost connection")
    picture = page.frame()["values"]
    assert picture, "the last picture stays"
    page.set("gain-value", "2")
    again = View(tmp_path / "station.toml", "--port", running.port, folder=tmp_path)
    try:
        assert again.port == running.port
        page.wait(lambda: page.text("connection") == "connected", "the connection")
        page.wait(lambda: (page.frame() or {"values": picture})["values"] != picture, "a picture of the new server")
        page.idle()
        assert page.value("gain-value") == "2" and page.text("problems") == ""
    finally:
        again.close()


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_the_view(view, tmp_path, sign):
    running = view(job=SMALL)
    running.wait_for_film(1)
    # A stream of events and a paused render do not keep it.
    connection = socket.create_connection((running.host, running.port), PATIENCE)
    connection.sendall(request("GET", "/api/events", host=f"127.0.0.1:{running.port}"))
    running.pause()
    body = {"what": ["exr", "film", "tiff"], "name": "last", "camera": running.camera(), "frame": 0}
    files = running.post("save", body)["files"]
    began = time.monotonic()
    running.process.send_signal(sign)
    assert running.process.wait(PATIENCE) == 130
    assert time.monotonic() - began < PATIENCE / 2
    connection.close()
    assert all((tmp_path / file).stat().st_size > 0 for file in files)
    assert {file.name for file in tmp_path.iterdir()} == {
        "station.toml",
        "messages.txt",
        "last.exr",
        "last.film",
        "last.tif",
    }


def test_an_interrupt_during_the_load_ends_it(view, tmp_path):
    (tmp_path / "bad.toml").write_text('scene = "none"\nwide = 1\n')
    running = view(tmp_path / "bad.toml")
    running.wait(lambda state: state["error"], "the error")
    assert running.interrupt() == 130
