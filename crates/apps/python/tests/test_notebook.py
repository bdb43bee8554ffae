"""Notebooks: tables and pictures, and the steps of a render."""

import base64
import html.parser
import re
import threading
from typing import Any

import dunkelfeld as df
import numpy as np
import pytest
from tqdm import tqdm


class Tags(html.parser.HTMLParser):
    """Collects the tags, and checks that each one is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.all: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        assert not self.open, self.open

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.all.append(tag)
        if tag not in ("img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_a_scene_is_a_table(job: dict[str, Any]) -> None:
    job["object"] = [*job["object"], *({"name": f"<b>{i}", "kind": "sphere", "diameter": 0.01} for i in range(20))]
    scene = df.Scene.from_job(dict(job, light=[df.Light(kind="point", name="a & b", position=[0, 1, 0])]))
    text = scene._repr_html_()
    tags = Tags(text)
    assert tags.all.count("tr") == 5 and "b" not in tags.all
    assert "ball (" in text and "&lt;b&gt;0" in text and "and 10 more" in text and "a &amp; b (point, 1 W)" in text


def test_a_noise_map_is_a_picture_about_k(job: dict[str, Any]) -> None:
    film = df.Scene.from_job(job).render(spp=16)
    noise = film.noise_map(k=0.5)
    assert noise.ratios.shape == (16, 24) and noise.ratios.dtype == np.float32
    assert np.allclose(noise.ratios**2, film.certificate(k=0.5)["ratios"], rtol=1e-6)
    assert noise.k == 0.5 and noise.range == (0.0625, 4.0) and noise.hidden == film.certificate(k=0.5)["hidden"]
    picture = noise.picture
    assert picture.shape == (16, 24, 3) and picture.dtype == np.uint8
    known = np.isfinite(noise.ratios)
    red, blue = picture[..., 0].astype(int), picture[..., 2].astype(int)
    assert ((blue > red) == (noise.ratios < 0.49))[known & ((noise.ratios < 0.49) | (noise.ratios > 0.51))].all()
    assert noise._repr_png_().startswith(b"\x89PNG")
    text = noise._repr_html_()
    assert {"figure", "img", "figcaption"} <= set(Tags(text).all) and "0.500 = k" in text
    embedded = re.findall(r"data:image/png;base64,([A-Za-z0-9+/=]+)", text)
    assert base64.b64decode(embedded[0]) == noise._repr_png_()
    assert "NoiseMap(24 x 16" in repr(noise)


@pytest.mark.parametrize("k", [0.0, -1.0, float("nan"), float("inf")])
def test_a_noise_map_needs_a_level_and_a_sensor(k: float, job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    with pytest.raises(df.SettingError, match="k"):
        scene.render(spp=2).noise_map(k=k)
    with pytest.raises(df.SettingError, match="sensor"):
        scene.render(spp=2, sensor="none").noise_map()


def test_steps_are_the_per_cents_of_a_render(job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    steps = scene.render_steps(seed=3)
    assert len(steps) == 100
    seen = list(steps)
    assert len(seen) == 100 and seen[-1].fraction == 1.0 and all(isinstance(s, df.RenderStep) for s in seen)
    fractions = [state.fraction for state in seen]
    assert fractions == sorted(fractions)
    assert np.array_equal(steps.film.mean, scene.render(seed=3).mean)


def test_tqdm_shows_the_steps(job: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    steps = df.Scene.from_job(job).render_steps(time=1.0)
    bar = tqdm(steps)
    stages = {state.stage for state in bar}
    assert bar.total == bar.n == 100 and "refine" in stages and "100/100" in capsys.readouterr().err
    assert steps.film.spp.sum() > 0 and not steps.film.interrupted


def test_an_early_end_keeps_the_film(job: dict[str, Any]) -> None:
    scene, threads = df.Scene.from_job(job), threading.active_count()
    steps = scene.render_steps(time=100)
    for state in steps:
        if state.fraction >= 0.01:
            break
    assert steps.film.interrupted and steps.film.spp.sum() > 0
    assert threading.active_count() == threads
    again = scene.render_steps(time=100)
    with pytest.raises(KeyboardInterrupt):
        for state in again:
            raise KeyboardInterrupt
    assert again.film.interrupted and scene.render().spp.sum() == 8 * 16 * 24


def test_errors_of_a_render_are_errors_of_its_steps(job: dict[str, Any]) -> None:
    scene = df.Scene.from_job(job)
    wrong: list[dict[str, Any]] = [{"ssp": 3}, {"progress": print}]
    for options in wrong:
        with pytest.raises(TypeError):
            scene.render_steps(**options)
    steps = scene.render_steps(spp=-1)
    with pytest.raises(ValueError, match="begun"):
        _ = steps.film
    for take in (lambda: list(steps), lambda: steps.film):
        with pytest.raises(df.SettingError, match="spp"):
            take()
    with pytest.raises(ValueError, match="once"):
        list(steps)
