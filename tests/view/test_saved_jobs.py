"""Jobs that the view saves render the picture that is shown, without options of the command line."""

import json
import re

import numpy as np
import pytest
from images import assert_equal_means, layers
from jobs import station
from PIL import Image
from program import Refused, run

FIXED = station(width=64, height=48, sensor='exposure = "5ms"')
BESIDE = """
[[camera]]
name = "beside"
position = ["400mm", "100mm", 0]
look_at = [0, 0, 0]
vertical_fov = "30deg"
[camera.lens]
vignetting = "cos4"
"""
# The second lamp belongs to the first camera.
RING = """
[[light]]
kind = "ring"
diameter = "120mm"
distance = "200mm"
power = 2
"""
TWO = FIXED.replace("[camera]", '[[camera]]\nname = "above"', 1) + BESIDE + RING


def save(running, what, name="saved", **changes):
    state = running.state()
    body = {"what": what, "name": name, "camera": {**state["camera"], **changes}, "frame": state["frame"]}
    return running.post("save", body)


def change(running, spp=24, **request):
    """Changes the scene, and waits for its picture."""
    before = running.state()
    running.post("scene", request)
    state = running.wait(
        lambda state: (
            state["error"]
            or (
                state["render"]["restarted"] > before["render"]["restarted"]
                and state["film"]["id"] > before["film"]["id"]
                and not state["film"]["earlier"]
                and state["film"]["spp"] >= spp
            )
        ),
        "the picture of the change",
    )
    assert state["error"] is None
    return state


def render(tmp_path, name="saved", spp=24):
    """Renders a saved job, and returns the layers of its EXR."""
    out = tmp_path / f"{name}-out"
    out.mkdir()
    run("render", f"{name}.toml", "--spp", spp, "-o", f"{out}/a.png", "--exr", f"{out}/a.exr", cwd=tmp_path)
    assert {file.name for file in out.iterdir()} == {"a.png", "a.exr"}, "one camera"
    return layers(out / "a.exr")


@pytest.mark.parametrize("camera", [None, "above", "beside"])
def test_the_camera_that_is_shown(view, tmp_path, camera):
    running = view(job=TWO)
    running.wait_for_film(24)
    if camera:
        change(running, camera=camera)
    running.pause()
    save(running, ["job", "exr"])
    assert_equal_means(render(tmp_path), layers(tmp_path / "saved.exr"))


@pytest.mark.parametrize("camera", ["left", "right"])
def test_a_camera_of_a_file_beside_one_of_the_job(view, tmp_path, camera):
    quarter = 0.5**0.5
    node = {"rotation": [-quarter, 0, 0, quarter]}
    gltf = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{**node, "camera": i, "name": name, "translation": [0.1 * i, 0.4, 0]}
                  for i, name in enumerate(["left", "right"])],
        "cameras": [{"type": "perspective", "name": name, "perspective": {"yfov": 0.7, "znear": 0.01}}
                    for name in ["left", "right"]],
    }  # fmt: skip
    (tmp_path / "two.gltf").write_text(json.dumps(gltf))
    running = view(job=FIXED.replace('scene = "none"', 'scene = "two.gltf"'))
    assert running.wait_for_film(1)["scene"]["cameras"] == ["camera", "left", "right"]
    change(running, spp=1, camera=camera)
    running.pause()
    save(running, ["job"])
    render(tmp_path, spp=1)


def test_the_denoiser_of_a_job(view, tmp_path):
    running = view(job=FIXED + '[denoise]\nmethod = "builtin"\n')
    running.wait_for_film(4)
    # The knob starts as in the job, and the saved job has that of the picture.
    assert running.camera()["denoise"] == "builtin"
    for method in ["builtin", "auto", "off"]:
        assert save(running, ["job"], method, denoise=method)["note"] is None
        section = re.findall(r"\[denoise\]\n((?:.+\n)*)", (tmp_path / f"{method}.toml").read_text())
        assert section == ([] if method == "off" else [f'method = "{method}"\n'])
    assert "plain noise" in save(running, ["job"], "none", noise="none")["note"]
    assert save(running, ["film"], "film", noise="none")["note"] is None


def test_a_denoiser_that_the_machine_lacks(view, tmp_path):
    (tmp_path / "no-library.so").write_text("no library")
    running = view(job=FIXED + '[denoise]\nmethod = "oidn"\noidn = "no-library.so"\n')
    state = running.wait_for_film(1)
    assert state["camera"]["denoise"] == "off"
    assert any("is not denoised" in note["text"] for note in state["notes"])
    running.frame()
    with pytest.raises(Refused):
        running.frame(denoise="oidn")


def test_a_gain_that_the_job_multiplies(view, tmp_path):
    running = view(job=FIXED.replace('exposure = "5ms"', 'exposure = "5ms"\ngain = 2'))
    running.wait_for_film(1)
    with pytest.raises(Refused) as refusal:
        save(running, ["job"], gain=60)
    fault = refusal.value.fault
    assert "knob has the gain 60" in fault["problem"] and "to 50" in fault["help"] and fault["place"] is None
    save(running, ["job"], gain=50)
    assert "\ngain = 100.0\n" in (tmp_path / "saved.toml").read_text()


def test_the_samples_of_a_job_without_a_sensor(view, tmp_path):
    running = view(job=FIXED.replace('model = "imx250"\nexposure = "5ms"', 'model = "none"'))
    for attempt in range(4):
        running.wait_for_film(8 + attempt)
        save(running, ["job", "exr"], f"n{attempt}")
        spp = layers(tmp_path / f"n{attempt}.exr")["spp.Y"].mean()
        (of_job,) = re.findall(r"^spp = (.+)$", (tmp_path / f"n{attempt}.toml").read_text(), re.MULTILINE)
        assert float(of_job) == pytest.approx(spp)


def test_a_finished_render(view, tmp_path):
    small = FIXED.replace("width = 64", "width = 4").replace("height = 48", "height = 4")
    running = view(job=small)
    state = running.wait(lambda state: state["render"]["state"] == "finished", "the last sample")
    assert (state["render"]["fraction"], state["render"]["remaining"]) == (1, None)
    assert state["film"]["spp"] == state["max_spp"] and "65536" in state["render"]["reason"]
    assert save(running, ["film"])["note"] is None
    assert view("saved.film").wait(lambda state: state["film"], "the film")["film"]["spp"] == state["max_spp"]
    # It still answers, and begins again.
    assert running.post("path", {"x": 1, "y": 1, "index": 0, "camera": running.camera()})["index"] == 0
    change(running, spp=1, lights={"left": {"on": True, "factor": 2}})


def test_vignetting_of_a_lens_of_the_camera(view, tmp_path):
    wide = FIXED.replace('vertical_fov = "30deg"', 'vertical_fov = "50deg"\nlens = { f_number = 2 }')
    running = view(job=wide)
    running.wait_for_film(24)
    save(running, ["job"], vignetting=True)
    (tmp_path / "cos4.toml").write_text(wide.replace("f_number = 2", 'f_number = 2, vignetting = "cos4"'))
    found = render(tmp_path)
    assert_equal_means(found, render(tmp_path, "cos4"))
    plain = render(tmp_path, "station")
    middle_of_top = np.s_[:3, 26:38]
    assert 0 < found["G"][middle_of_top].mean() < 0.8 * plain["G"][middle_of_top].mean()


def test_the_lens_of_a_job(view, tmp_path):
    lens = '[lens]\nprojection = "telecentric"\nfield_height = "90mm"\nnumerical_aperture = 0.0002\n'
    running = view(job=FIXED.replace('vertical_fov = "30deg"\n', "") + lens)
    lens = running.wait_for_film(24)["lens"]
    assert save(running, ["job"], "same", f_number=None, glare=None)["note"] is None
    stopped = {"f_number": 2 * lens["f_number"], "glare": 0.02}
    assert save(running, ["job", "exr"], **stopped)["note"] is None
    text = (tmp_path / "saved.toml").read_text()
    assert "glare = 0.02" in text and "numerical_aperture" not in text
    # The job renders the picture behind this lens.
    shown, rendered = layers(tmp_path / "saved.exr"), render(tmp_path)
    ratio = rendered["electrons.Y"].mean() / shown["electrons.Y"].mean()
    assert ratio == pytest.approx(rendered["G"].mean() / shown["G"].mean(), rel=1e-3)


@pytest.mark.parametrize(("more", "word"), [
    ('[lens]\nfilter = { center = "625nm", width = "40nm" }\n', "filter"),
    ('[[object]]\nname = "ball"\nvelocity = ["1m/s", 0, 0]\n', "sensor"),
])  # fmt: skip
def test_a_job_that_render_refuses_is_not_saved(view, tmp_path, more, word):
    running = view(job=FIXED + more)
    running.wait_for_film(1)
    for what in [["job"], ["film", "job"]]:
        with pytest.raises(Refused) as refusal:
            save(running, what, sensor=None)
        assert refusal.value.status == 422 and word in refusal.value.text, refusal.value.text
    assert not (tmp_path / "saved.toml").exists() and not (tmp_path / "saved.film").exists()
    # It is the reason of the command, for the same job with this sensor.
    save(running, ["job"])


def test_a_lens_in_lengths_behind_another_sensor(view, tmp_path):
    job = FIXED.replace('vertical_fov = "30deg"\n', "") + '[lens]\nfocal_length = "1mm"\nfocus_distance = "300mm"\n'
    running = view(job=job)
    running.wait_for_film(24)
    assert save(running, ["job"], "same")["note"] is None
    assert "another field of view" in save(running, ["job"], "other", sensor="imx183")["note"]


def test_the_limit_of_memory_stays(view, tmp_path):
    running = view(job=FIXED + '[budget]\ntime = "20s"\nmemory = "3GB"\n')
    running.wait_for_film(1)
    save(running, ["job"])
    text = (tmp_path / "saved.toml").read_text()
    assert 'memory = "3GB"' in text and "20s" not in text


def test_all_files_or_none(view, tmp_path):
    (tmp_path / "station.toml").write_text(FIXED)
    (tmp_path / "out").mkdir()
    running = view(tmp_path / "station.toml", "--output", "out")
    running.wait_for_film(1)
    (tmp_path / "out").rmdir()
    with pytest.raises(Refused):
        save(running, ["job", "png"])
    assert not (tmp_path / "saved.toml").exists() and running.state()["saved"] == []


def test_only_changed_values_of_materials_are_kept(view, tmp_path):
    running = view(job=FIXED)
    materials = running.wait_for_film(1)["scene"]["materials"]
    # All values, as a page of another program may send them.
    sent = {m["name"]: {key: m[key] for key in ("roughness", "metallic", "color")} for m in materials}
    sent["ball"]["roughness"] = 0.1
    state = change(running, materials=sent, spp=1)
    assert [m["changed"] for m in state["scene"]["materials"]] == [{}, {"roughness": 0.1}, {}]
    save(running, ["job"])
    assert '[[material]]\nname = "ball"\nroughness = 0.1\n' in (tmp_path / "saved.toml").read_text()
    text = FIXED.replace("base_color = 0.4", "base_color = 0.05").replace("metallic = 1\n", "metallic = 0\n")
    (tmp_path / "station.toml").write_text(text)
    state = running.wait(lambda state: state["render"]["restarted"] == 2 and state["film"]["spp"] >= 1, "the new job")
    plate, ball, _ = state["scene"]["materials"]
    assert plate["color"] == [0.05] * 3 and (ball["metallic"], ball["roughness"]) == (0, 0.1)


def test_a_textured_colour_is_no_value(view, tmp_path):
    """Without textures, the material has the mean of its texture, which a colour would multiply."""
    Image.fromarray(np.full((2, 2, 3), 100, np.uint8)).save(tmp_path / "grey.png")
    (tmp_path / "tile.mtl").write_text("newmtl tile\nKd 1 1 1\nmap_Kd grey.png\n")
    corners = "v -1 0.02 -1\nv 1 0.02 -1\nv 1 0.02 1\nv -1 0.02 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    (tmp_path / "tile.obj").write_text(f"mtllib tile.mtl\n{corners}o tile\nusemtl tile\nf 1/1 4/4 3/3 2/2\n")
    running = view(job=FIXED.replace('scene = "none"', 'scene = "tile.obj"'))
    running.wait_for_film(24)

    def tile(state):
        return next(material for material in state["scene"]["materials"] if material["name"] == "tile")

    save(running, ["exr"], "before")
    assert tile(running.state())["color"] is None
    assert tile(change(running, effects={"textures": False}))["color"] is None
    change(running, materials={"tile": {"roughness": 0.9}})
    change(running, effects={"textures": True}, materials={"tile": None})
    save(running, ["exr", "job"], "after")
    assert "tile" not in (tmp_path / "after.toml").read_text().replace('"tile.obj"', "")
    assert_equal_means(layers(tmp_path / "after.exr"), layers(tmp_path / "before.exr"))
    # A file that gains the texture while textures are left out, and while a colour is changed.
    plain = "newmtl tile\nKd 0.5 0.5 0.5\n"
    (tmp_path / "tile.mtl").write_text(plain)
    running.wait(lambda state: tile(state)["color"], "the plain material")
    change(running, effects={"textures": False}, materials={"tile": {"color": [0.3] * 3}}, spp=1)
    (tmp_path / "tile.mtl").write_text("newmtl tile\nKd 1 1 1\nmap_Kd grey.png\n")
    state = running.wait(lambda state: tile(state)["color"] is None and state["error"] is None, "the texture")
    assert tile(state)["changed"] == {}
    with pytest.raises(Refused) as refusal:
        running.post("scene", {"materials": {"tile": {"color": [0.3] * 3}}})
    assert "texture" in refusal.value.fault["problem"]
    change(running, effects={"textures": True})
    save(running, ["exr", "job"], "again")
    assert "base_color = [0.3" not in (tmp_path / "again.toml").read_text()
    assert_equal_means(layers(tmp_path / "again.exr"), layers(tmp_path / "before.exr"))


@pytest.mark.parametrize("powers", [(0.5, 0.5), (0.5, 0.1)])
def test_lights_that_share_a_name(view, tmp_path, powers):
    """A factor is that of the light of all of them."""
    job = FIXED.replace("power = 0.5", f"power = {powers[0]}", 1)
    job = f"power = {powers[1]}".join(job.rsplit("power = 0.5", 1))
    for name in ["left", "right"]:
        job = job.replace(f'name = "{name}"', 'name = "lamp"')
    running = view(job=job)
    running.wait_for_film(40)
    save(running, ["exr"], "before")
    state = change(running, lights={"lamp": {"on": True, "factor": 2}}, spp=40)
    assert state["scene"]["lights"][0]["power"] == f"{2 * sum(powers):.3f} W"
    save(running, ["exr", "job"], "after")
    before = layers(tmp_path / "before.exr")
    assert_equal_means(layers(tmp_path / "after.exr"), before, 2)
    assert_equal_means(render(tmp_path, "after"), before, 2)


def test_names_of_lights_are_no_patterns(view, tmp_path):
    job = FIXED.replace('name = "left"', 'name = "l?mp"').replace('name = "right"', 'name = "lamp"')
    running = view(job=job)
    running.wait_for_film(1)
    state = change(running, lights={"l?mp": {"on": False, "factor": 1}}, spp=24)
    assert state["scene"]["per_light"]["lights"] == 1
    save(running, ["exr", "job"])
    (tmp_path / "one.toml").write_text(FIXED + '[[light]]\nname = "left"\nenabled = false\n')
    one = render(tmp_path, "one")
    assert_equal_means(layers(tmp_path / "saved.exr"), one)
    assert_equal_means(render(tmp_path), one)
