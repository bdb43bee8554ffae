"""The knobs of the camera: the values of the page against those of `dunkelfeld expose` and of saved files."""

import json

import numpy as np
import pytest
from images import grey_values, layers, picture, write_exr
from jobs import COLOUR_SENSOR, station
from program import Refused, View, run

OWN = "as in the job"


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A film of the station with 16 samples per pixel, saved by a view as film.film and film.exr."""
    return stored_in(tmp_path_factory.mktemp("stored"), station())


@pytest.fixture(scope="module")
def behind_lens(tmp_path_factory):
    """The same behind a lens with the diffraction of f/4."""
    return stored_in(tmp_path_factory.mktemp("lens"), station(more="[lens]\nf_number = 4\n"))


def stored_in(folder, job):
    (folder / "station.toml").write_text(job)
    view = View("station.toml", folder=folder)
    view.wait_for_film(16)
    view.pause()
    saved = view.post("save", {"what": ["film", "exr"], "name": "film", "camera": view.camera(), "frame": 0})
    assert [name.removeprefix("./") for name in saved["files"]] == ["film.film", "film.exr"]
    view.close()
    return folder


@pytest.fixture
def film(stored, tmp_path, view):
    """A view of the stored film."""
    return view(stored / "film.film")


def values_of(page, width=96, height=72):
    page.wait(lambda: page.frame()["header"]["analysis"] == "exact", "the analysis of this picture")
    frame = page.frame()
    assert frame["header"]["format"] == "gray16"
    return frame["header"], np.array(frame["values"], np.uint16).reshape(height, width)


def camera_of(page):
    return page.js("return window.dunkelfeld.frame().camera")


def exposed(stored, folder, *flags):
    run("expose", stored / "film.exr", "--linear", "exposed.tif", *flags, cwd=folder)
    return grey_values(folder / "exposed.tif")


def test_first_picture_of_a_job(view, open_page):
    page = open_page(view())
    page.wait(lambda: page.state()["film"]["spp"] >= 4, "samples")
    assert page.text("title").startswith("station.toml")
    assert page.text("connection") == "connected"
    page.click("pause")
    page.wait(lambda: page.state()["render"]["state"] == "paused", "the pause")
    page.wait(lambda: page.film() == page.state()["film"]["id"], "the picture of the last film")
    page.assert_quiet_console()


# Knobs of the page, and the flags of `dunkelfeld expose` with the same meaning. The exposure is without film noise but for
# the last, which matches it.
EXPOSURES = [
    ([], []),
    ([("sensor", "imx174")], ["--sensor", "imx174"]),
    ([("sensor", "imx900-hcg"), ("exposure-value", "2 ms")], ["--sensor", "imx900-hcg", "--exposure", "2ms"]),
    ([("exposure-value", "50 ms"), ("device", "7")], ["--exposure", "50ms", "--seed", "7"]),
    ([("noise", "matched")], ["--exposure-noise", "matched"]),
]


@pytest.mark.parametrize(("knobs", "flags"), EXPOSURES)
def test_grey_values_are_those_of_expose(film, stored, tmp_path, open_page, knobs, flags):
    page = open_page(film)
    for id_, value in knobs:
        page.set(id_, value)
    page.idle()
    assert page.text("problems") == ""
    seed = [] if "--seed" in flags else ["--seed", "3"]
    sensor = [] if "--sensor" in flags else ["--sensor", "imx250"]
    _, values = values_of(page)
    assert np.array_equal(values, exposed(stored, tmp_path, *seed, *sensor, *flags))
    page.click("next-frame")
    _, second = values_of(page)
    assert not np.array_equal(values, second)
    if "matched" not in flags:
        assert np.array_equal(second, exposed(stored, tmp_path, "--frame", "1", *seed, *sensor, *flags))
    page.assert_quiet_console()


# Knobs of the lens, and the flags of `dunkelfeld expose`.
LENSES = [
    ([("f-number-value", "8")], ["--f-number", "8"]),
    ([("f-number-value", "2.8"), ("exposure-value", "5 ms")], ["--f-number", "2.8", "--exposure", "5ms"]),
    ([("glare-value", "2"), ("exposure-value", "5 ms")], ["--glare", "0.02", "--exposure", "5ms"]),
    ([("f-number-value", "11"), ("noise", "matched")], ["--f-number", "11", "--exposure-noise", "matched"]),
]


@pytest.mark.parametrize(("knobs", "flags"), LENSES)
def test_the_lens_is_that_of_expose(behind_lens, tmp_path, view, open_page, knobs, flags):
    running = view(behind_lens / "film.film")
    page = open_page(running)
    assert page.value("f-number-value") == "4" and page.value("glare-value") == "0"
    for id_, value in knobs:
        page.set(id_, value)
    page.idle()
    assert page.text("problems") == ""
    _, values = values_of(page)
    assert np.array_equal(values, exposed(behind_lens, tmp_path, "--seed", "3", *flags))
    # The EXR has the same knobs.
    camera = {**camera_of(page), "sensor": "imx250", "noise": "plain"}
    if "matched" not in flags:
        _, values = view(behind_lens / "film.exr").picture("frame", {"camera": camera, "frame": 0, "tone": "gamma"})
        assert np.array_equal(values, exposed(behind_lens, tmp_path, "--seed", "3", *flags))
    # An empty text is that of the job.
    page.set("f-number-value", "")
    page.set("glare-value", "")
    assert (camera_of(page)["f_number"], camera_of(page)["glare"]) == (None, None)
    page.assert_quiet_console()


def test_a_smaller_aperture_takes_light_and_widens_edges(behind_lens, view):
    running = view(behind_lens / "film.film")
    running.wait(lambda state: state["film"], "the film")
    shots = [(4, 3e-4), (16, 16 * 3e-4)]
    (header, open_), (stopped, closed) = [running.frame(f_number=n, exposure=t, noise="none") for n, t in shots]
    assert stopped["mean_electrons"] == pytest.approx(header["mean_electrons"], rel=1e-4)

    def contrast(values, header):
        light = values.astype(float) - header["black"]
        return np.abs(np.diff(light, axis=1)).max() / light.mean()

    assert contrast(closed, stopped) < 0.9 * contrast(open_, header)
    # Noise behind the wider disc: a larger share of the pixels is hidden, though the camera has less light.
    _, ratios = running.picture("map", {"camera": running.camera(f_number=16), "map": "ratio"})
    _, before = running.picture("map", {"camera": running.camera(f_number=4), "map": "ratio"})
    assert np.nanmedian(ratios) < 0.8 * np.nanmedian(before)
    for knob in [{"f_number": 0.4}, {"glare": 0.6}, {"glare": -0.1}]:
        with pytest.raises(Refused) as refusal:
            running.frame(**knob)
        assert "out of range" in refusal.value.fault["problem"]


@pytest.mark.parametrize(
    ("lens", "reason"),
    [("", "sharp image"), ('[lens]\nf_number = 4\nfocus_distance = "300mm"\n', "depth of field")],
)
def test_an_f_number_that_needs_new_samples(view, open_page, lens, reason):
    running = view(job=station(more=lens))
    page = open_page(running)
    page.wait(lambda: page.disabled("f-number") and page.disabled("f-number-value"), "the reason")
    assert reason in page.attribute("f-number", "title") and not page.disabled("glare")
    with pytest.raises(Refused) as refusal:
        running.frame(f_number=8)
    assert reason in refusal.value.fault["problem"] and "[lens]" in refusal.value.fault["help"]
    # The glare needs no new samples.
    dark = running.frame(exposure=5e-3, noise="none")[1].min()
    assert running.frame(exposure=5e-3, noise="none", glare=0.1)[1].min() > dark
    page.assert_quiet_console()


@pytest.mark.parametrize(
    ("knobs", "mean"),
    [
        ([("gain-value", "2.5"), ("exposure-value", "1 ms")], None),
        ([("sensor", "imx183"), ("gain-value", "0.5")], None),
        ([("temperature-value", "70"), ("exposure-value", "5 ms")], None),
        ([("black-level", "200"), ("gain-value", "0.01"), ("exposure-value", "19 us")], 200),
    ],
)
def test_grey_values_are_those_of_the_saved_files(film, tmp_path, open_page, knobs, mean):
    page = open_page(film)
    for id_, value in knobs:
        page.set(id_, value)
    page.click("device-next")
    page.click("next-frame")
    page.click("save-tiff")
    assert page.checked("save-png") and page.checked("save-tiff")
    page.set("save-name", "saved")
    page.click("save")
    assert page.text("problems") == "" and page.text("save-result") == "Saved 2 files."
    header, values = values_of(page)
    assert np.array_equal(values, grey_values(tmp_path / "saved.tif"))
    if mean is not None:
        # So short an exposure has some electrons in each pixel, far below one grey value: the mean is the black level.
        assert abs(values.mean() - mean) < 1 and header["black"] == mean
    assert_canvas_is(page, picture(tmp_path / "saved.png"))
    page.assert_quiet_console()


def assert_canvas_is(page, saved):
    """Each pixel of the canvas at 1:1 is that of a saved picture, to one step of 255."""
    height, width, _ = saved.shape
    page.click("one-to-one")
    x0, y0 = page.origin(width, height)
    shown = np.array(page.pixels(x0, y0, width, height)).reshape(height, width, 4)
    assert (shown[..., 3] == 255).all()
    assert np.abs(shown[..., :3].astype(int) - saved.astype(int)).max() <= 1


def test_gain_is_a_factor_of_the_grey_values(film):
    # Without noise: the grey value above the black level is proportional to the gain, to half a grey value each.
    plain = {"noise": "none", "exposure": 1e-3, "black_level": 32}
    _, one = film.frame(**plain)
    _, two = film.frame(**plain, gain=2)
    unsaturated = two < 4000
    assert unsaturated.mean() > 0.9
    assert np.abs(two.astype(float) - 32 - 2 * (one.astype(float) - 32))[unsaturated].max() <= 1.5


def test_probe_has_the_values_of_the_exr(film, stored, open_page):
    exr = layers(stored / "film.exr")
    _, values = film.frame()
    camera = film.camera()
    for x, y in [(0, 0), (95, 71), (30, 36), (66, 36), (48, 10), (20, 60)]:
        found = film.post("probe", {"camera": camera, "frame": 0, "x": x, "y": y})
        assert found["radiance"] == pytest.approx([exr[c][y, x] for c in "RGB"], rel=1e-6)
        assert found["electrons"] == pytest.approx(exr["electrons.Y"][y, x], rel=1e-6)
        assert found["samples"] == exr["spp.Y"][y, x]
        assert found["depth"] == pytest.approx(exr["depth.Z"][y, x], rel=1e-6)
        # The layer has the ratio of the variances.
        if np.isfinite(exr["hidden.Y"][y, x]):
            assert found["ratio"] ** 2 == pytest.approx(exr["hidden.Y"][y, x], rel=1e-5)
        assert found["value"] == values[y, x]
    for x, name in [(33, "ball"), (63, "lid"), (48, "plate")]:
        found = film.post("probe", {"camera": camera, "frame": 0, "x": x, "y": 36})
        # Objects and materials of the scene have the same names.
        assert (found["object"], found["material"]) == (name, name)
    page = open_page(film)
    page.click("one-to-one")
    x0, y0 = page.origin(96, 72)
    page.mouse((x0 + 33, y0 + 36), drag=True)
    page.wait(lambda: page.text("probe-place") == "33, 36", "the pinned pixel")
    assert page.text("probe-value") == f"{values[36, 33]} DN" and page.text("probe-object") == "ball"
    page.assert_quiet_console()


def test_certificate_is_that_of_the_command(view, tmp_path):
    """The plan of the film renders it again: both count the same pixels, of which some are saturated."""
    running = view(job=station(sensor='exposure = "5ms"'))
    running.wait_for_film(40)
    film = running.pause()["film"]["id"]
    state = running.wait(lambda state: state["certificate"]["film"] == film, "the certificate of the last film")
    running.post("save", {"what": ["exr"], "name": "plan", "camera": running.camera(), "frame": 0})
    run("render", "station.toml", "--replay", "plan.exr", "-o", "again.png", "--stats", "again.json", cwd=tmp_path)
    certificate = json.loads((tmp_path / "again.json").read_text())["certificate"]
    assert certificate["saturated"] > 0 and certificate["k"] == state["target"]
    shown = state["certificate"]
    assert (shown["hidden"], shown["saturated"]) == (certificate["hidden"], certificate["saturated"])
    assert shown["p99"] ** 2 == pytest.approx(certificate["ratio_p99"], rel=1e-9)
    assert shown["median"] ** 2 == pytest.approx(certificate["ratio_p50"], rel=1e-9)


def test_measurements_are_those_of_the_frame(film):
    _, values = film.frame(frame=4)
    camera = film.camera()
    boxes = [[10, 20, 31, 33], [60, 5, 61, 70]]
    found = film.post("regions", {"camera": camera, "frame": 4, "regions": boxes})
    for (x0, y0, x1, y1), region in zip(boxes, found["regions"], strict=True):
        inside = values[y0:y1, x0:x1].astype(float)
        assert region["pixels"] == inside.size and region["mean"] == pytest.approx(inside.mean())
        assert region["variance"] == pytest.approx(inside.var(ddof=1))
        assert (region["min"], region["max"]) == (inside.min(), inside.max())
        assert sum(region["histogram"]["counts"]) == inside.size
    means = [region["mean"] for region in found["regions"]]
    assert found["contrast"] == pytest.approx(means[0] - means[1])
    # A line along a row has each of its pixels once, whatever its length.
    for x0, x1 in [(0, 95), (7, 14), (80, 3), (5, 5)]:
        line = film.post("line", {"camera": camera, "frame": 4, "from": [x0, 36], "to": [x1, 36]})
        step = 1 if x1 >= x0 else -1
        assert line["values"] == values[36, list(range(x0, x1 + step, step))].tolist(), (x0, x1)
        assert line["length"] == abs(x1 - x0)
    transfer = film.post("photon-transfer", {"camera": film.camera(exposure=2e-3)})
    # The slope of variance over mean is the system gain. The line has 24 points with at least 280 pixels each: a
    # relative standard deviation of 9 % of each variance, 2 % of the slope; six of these.
    assert transfer["line"]["slope"] == pytest.approx(transfer["gain"], rel=0.12)


def natural_vignetting(width=96, height=72, vertical_fov=30):
    """The fourth power of the cosine of the field angle, at the centres of the pixels of the station."""
    half = np.tan(np.radians(vertical_fov / 2))
    x = (2 * (np.arange(width) + 0.5) / width - 1) * half * width / height
    y = (2 * (np.arange(height) + 0.5) / height - 1) * half
    return (1 + x[None, :] ** 2 + y[:, None] ** 2) ** -2.0


@pytest.mark.parametrize("rendered", [False, True])
@pytest.mark.parametrize("noise", ["plain", "matched"])
def test_vignetting_is_a_knob_without_new_samples(view, tmp_path, open_page, rendered, noise):
    lens = '[lens]\nvignetting = "cos4"\n' if rendered else ""
    running = view(job=station(sensor='exposure = "2ms"', more=lens))
    running.wait_for_film(16)
    running.pause()
    assert running.camera()["vignetting"] is rendered
    share = natural_vignetting()
    factor = 1 / share if rendered else share
    own, other = running.camera(noise=noise), running.camera(noise=noise, vignetting=not rendered)
    for x, y in [(0, 0), (95, 71), (48, 36), (20, 60)]:
        one, two = (running.post("probe", {"camera": c, "frame": 0, "x": x, "y": y}) for c in [own, other])
        assert two["electrons"] == pytest.approx(one["electrons"] * factor[y, x], rel=1e-5)
        assert two["radiance"] == pytest.approx(np.multiply(one["radiance"], factor[y, x]), rel=1e-5)
        assert one["samples"] == two["samples"]
    # The noise of the render has the same factor, in all pixels where it is known.
    ask = [{"map": "render_sigma", "camera": camera} for camera in [own, other]]
    one, two = (running.picture("map", body)[1] for body in ask)
    known = np.isfinite(one)
    assert known.mean() > 0.9 and (known == np.isfinite(two)).all()
    # Samples above saturation count less, so that the brightest pixels differ.
    error = np.abs(two / (one * factor) - 1)[known]
    assert (error < 0.005).mean() > 0.99 and np.median(error) < 1e-5
    # The page has the knob, and the files have its value.
    page = open_page(running)
    page.set("noise", noise)
    page.click("vignetting")
    assert page.text("problems") == "" and page.checked("vignetting") is not rendered
    _, values = values_of(page)
    body = {"what": ["png", "tiff", "job"], "name": "other", "camera": other, "frame": 0}
    running.post("save", body)
    assert (grey_values(tmp_path / "other.tif") == values).all()
    wanted = "none" if rendered else "cos4"
    assert f'vignetting = "{wanted}"' in (tmp_path / "other.toml").read_text()
    with pytest.raises(Refused) as refusal:
        running.post("save", {**body, "what": ["exr"], "name": "refused"})
    assert "layers" in refusal.value.fault["problem"]
    assert running.state()["render"]["restarted"] == 0
    page.assert_quiet_console()


def test_refused_knobs_keep_the_picture(film, open_page):
    page = open_page(film)
    before = page.frame()["values"]
    page.set("denoise", "oidn")
    assert page.text("problems") != "" and page.frame()["values"] == before
    page.set("denoise", "builtin")
    page.wait(lambda: page.frame()["header"]["analysis"] == "exact", "the denoised picture")
    assert page.text("problems") == "" and page.frame()["values"] != before
    page.click("camera-reset")
    assert page.text("problems") == "" and page.frame()["values"] == before
    page.assert_quiet_console(refusals=True)


def test_colour_sensor(view, tmp_path, open_page):
    (tmp_path / "colour.toml").write_text(COLOUR_SENSOR)
    job = station().replace('"imx250"', '"colour.toml"')
    running = view(job=job)
    running.wait_for_film(8)
    running.pause()
    page = open_page(running)
    page.wait(lambda: page.film() == running.state()["film"]["id"], "the picture of the last film")
    assert page.frame()["header"]["format"] == "rgb8"
    page.set("gain-value", "1.5")
    page.set("save-name", "colour")
    page.click("save-tiff")
    page.click("save")
    assert page.text("problems") == ""
    assert_canvas_is(page, picture(tmp_path / "colour.png"))
    # The probe has the grey value of the mosaic.
    mosaic = grey_values(tmp_path / "colour.tif")
    camera = running.camera(gain=1.5)
    for x, y in [(3, 4), (50, 20), (51, 20), (50, 21), (51, 21)]:
        assert running.post("probe", {"camera": camera, "frame": 0, "x": x, "y": y})["value"] == mosaic[y, x]
    # A monochrome sensor of the list instead of it.
    page.set("sensor", "imx174")
    assert page.frame()["header"]["format"] == "gray16"
    page.assert_quiet_console()


def test_no_sensor(view, tmp_path, open_page):
    job = station().replace('model = "imx250"\nexposure = "auto"', 'model = "none"')
    running = view(job=job)
    running.wait_for_film(8)
    running.pause()
    page = open_page(running)
    page.wait(lambda: page.film() == running.state()["film"]["id"], "the picture of the last film")
    assert page.value("sensor") == "" and page.frame()["header"]["format"] == "rgb8"
    page.set("save-name", "plain")
    page.click("save")
    assert page.text("problems") == "" and page.text("save-result") == "Saved 1 file."
    assert_canvas_is(page, picture(tmp_path / "plain.png"))
    # No grey values without a sensor: measurements are refused with a reason.
    page.set("sensor", "imx174")
    assert page.frame()["header"]["format"] == "gray16" and page.text("problems") == ""
    page.assert_quiet_console()


def test_an_own_exr_has_verdict_samples_and_names(film, stored, view, open_page):
    """Those of the film that was saved with it."""
    running = view(stored / "film.exr")
    page = open_page(running)
    for x, y in [(48, 36), (5, 60)]:
        found, expected = [
            of.post("probe", {"camera": of.camera(), "frame": 0, "x": x, "y": y}) for of in (running, film)
        ]
        assert found["samples"] == expected["samples"] and found["ratio"] is not None
        assert [found[key] for key in ("object", "material")] == [expected[key] for key in ("object", "material")]
    page.wait(lambda: page.state()["certificate"] is not None, "the certificate")
    assert page.state()["film"]["spp"] == film.state()["film"]["spp"]
    page.wait(lambda: page.text("verdict-k") != "", "the verdict")
    page.assert_quiet_console()


def test_exr_of_another_renderer(stored, view, tmp_path, open_page):
    rng = np.random.default_rng(5)
    colours = {c: (0.2 + rng.random((40, 64))).astype(np.float32) for c in "RGB"}
    write_exr(tmp_path / "other.exr", **colours)
    running = view(tmp_path / "other.exr")
    page = open_page(running)
    assert page.state()["source"] == "exr"
    page.set("exposure-value", "3 ms")
    page.set("device", "11")
    run("expose", "other.exr", "--linear", "other.tif", "--exposure", "3ms", "--seed", "11", cwd=tmp_path)
    _, values = values_of(page, 64, 40)
    assert np.array_equal(values, grey_values(tmp_path / "other.tif"))
    found = running.post("probe", {"camera": running.camera(), "frame": 0, "x": 9, "y": 8})
    assert found["radiance"] == pytest.approx([colours[c][8, 9] for c in "RGB"], rel=1e-6)
    assert not page.hidden("scene-none") and page.hidden("scene-knobs")
    page.set("sensor", "")
    assert page.frame()["header"]["format"] == "rgb8"
    page.assert_quiet_console()
    # Changes of a scene that is not there.
    for path, body in [("scene", {}), ("render", {"action": "pause"}), ("path", {"x": 0, "y": 0, "index": None})]:
        status, _, _ = running.request("POST", f"/api/{path}", json.dumps(body), {"content-type": "application/json"})
        assert status == 422, path


def test_values_follow_the_film_while_it_grows(view, open_page):
    """With automatic exposure: header and values of a picture belong to one film, and its id never decreases."""
    running = view(job=station(width=64, height=48))
    page = open_page(running)
    ids = []
    for step in range(12):
        page.set("gain-value", str(1 + step % 3))
        frame = page.frame()
        header, values = frame["header"], np.array(frame["values"])
        assert header["mean_value"] == pytest.approx(values.mean())
        ids.append(header["film"])
    assert ids == sorted(ids)
    page.wait(lambda: page.film() >= ids[0] + 3, "films")
    assert page.text("problems") == ""
    page.assert_quiet_console()
