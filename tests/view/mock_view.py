"""The synthetic data of the server of the tests: a render that can be held at any second, which no real render can.

Each request is checked against docs/view-protocol.md. One that breaks it gets the status 400.
"""

import math
import threading
import time

import numpy as np
from mock_data import (
    BAYER,
    CAMERA_KEYS,
    EFFECTS,
    JOB_CAMERA,
    K_START,
    LIGHTS,
    MAPS,
    MATERIALS,
    MAX_SPP,
    PILOT,
    RANGES,
    SENSORS,
    make_scene,
)


class Fault(Exception):
    def __init__(self, status, problem, place=None, help_=None):
        super().__init__(problem)
        self.status = status
        self.body = {"problem": problem, "place": place, "help": help_}


class MockView:
    def __init__(self, options):
        self.width, self.height = options.width, options.height
        self.options = options
        self.radiance, self.objects, self.noise = make_scene(self.width, self.height)
        self.lock = threading.RLock()
        self.target, self.restarted, self.paused = 0.5, 0, False
        self.camera_name, self.per_light = "front", False
        self.lights = {name: {"on": True, "factor": 1.0} for name, _, _ in LIGHTS}
        self.materials = [{**m, "changed": {}} for m in MATERIALS]
        self.left_out, self.saved = set(), []
        self.log, self.settings = [], {"delay": 0.0, "frozen": options.freeze}
        # `mute`: no state is sent. `no_picture`: the film of the state is not there yet. `regions`: a fault of all regions.
        # `black`: frames without light. `light_fields`: other fields of a light, by its name.
        # `samples`: the number of samples in each pixel.
        self.settings |= {
            "mute": options.mute,
            "no_picture": False,
            "regions": None,
            "black": False,
            "saturated": None,
            "analysis": "exact",
            "prepared": 0,
            "timed": None,
            "fixed": None,
            "light_fields": {},
            "samples": None,
            "frame": 0,
            "exposure": JOB_CAMERA["exposure"],
            "other_camera": False,
            "earlier_picture": False,
        }
        # The camera of the statistics.
        self.statistics_of = JOB_CAMERA
        self.begin, self.paused_at, self.film_offset = time.time(), 0.0, 0
        self.connected = False
        # The number of streams of events that are open.
        self.streams = 0

    # State ---------------------------------------------------------------------------------------
    def seconds(self):
        if self.settings["frozen"] is not None:
            return self.settings["frozen"]
        if self.paused:
            return self.paused_at
        return (time.time() - self.begin) * self.options.speed

    def film(self):
        seconds = self.seconds()
        if seconds < 0.3:
            return None
        step = int(seconds) if seconds >= 1 else 0
        step = min(step, 120)
        spp = max(0.25, 12.0 * step)
        return {
            "id": self.film_offset + step + 1,
            "samples": 0 if self.options.source == "exr" else int(spp * self.width * self.height),
            "spp": spp,
            "seconds": float(step),
            "first": step == 0,
            "earlier": self.settings["earlier_picture"],
        }

    def level(self, seconds):
        return K_START / math.sqrt(max(seconds, 0.1)) * (1 + 0.06 * math.sin(3 * math.log(seconds + 1)))

    def state(self):
        """The state. With `other_camera`, it has the statistics of another camera."""
        seconds, film = self.seconds(), self.film()
        render = {
            "stage": "render",
            "fraction": min(1, seconds / 120),
            "elapsed": seconds,
            "remaining": max(0.0, 120 - seconds),
            "state": "running",
            "reason": None,
            "restarted": self.restarted,
            "samples_per_second": 3.7e6,
            "processor_share": 0.97,
        }
        if film is None:
            render.update(state="loading", stage="build the acceleration structure")
        elif seconds >= 120:
            render.update(state="finished", reason="The time of the job was used.", remaining=None)
        elif self.paused:
            render.update(state="paused")
        if self.options.source != "render":
            render.update(state="none", samples_per_second=0.0, remaining=None, stage="")
        times = [t for t in np.geomspace(1, max(1.01, min(seconds, 120)), 24)] if seconds >= 1 else []
        curve = [
            {
                "seconds": t,
                "spp": 12 * t,
                "k99": None if t < 1.1 else self.level(t),
            }
            for t in times
        ]
        forecast = (
            []
            if film is None or film["spp"] <= PILOT
            else [
                {"k": k, "seconds": (K_START / k) ** 2 * 0.97, "spp": 12 * (K_START / k) ** 2}
                for k in (2, 1, 0.7, 0.5, 0.25)
            ]
        )
        if film and self.options.source != "render":
            # Samples of a file have no times.
            film["seconds"], forecast = 0.0, []
            curve = [{**curve[-1], "seconds": 0.0, "spp": film["spp"]}] if self.options.source == "film" else []
        now = self.level(seconds) if film else None
        certificate = (
            None
            if not film or film["first"] or self.options.source == "exr"
            else {
                "k": self.target,
                "hidden": min(0.9999, 0.99 ** ((now / self.target) ** 2)),
                "median": now / 4.1,
                "p99": now,
                "saturated": 214,
                "film": film["id"],
            }
        )
        scene = None
        if self.options.source == "render" and not (film is None and self.settings.get("error")):
            scene = {
                "cameras": ["front", "oblique 30°"],
                "camera": self.camera_name,
                "lights": [
                    {"name": n, "kind": k, "power": p, "has_power": True, "has_switch": True, **self.lights[n]}
                    | self.settings["light_fields"].get(n, {})
                    for n, k, p in LIGHTS
                ],
                "materials": self.materials,
                "effects": [{"name": n, "title": t, "used": u, "left_out": n in self.left_out} for n, t, u in EFFECTS],
                "per_light": {
                    "on": self.per_light,
                    "bytes": self.width * self.height * 96 * 3,
                    "lights": self.lights_on(),
                },
            }
        return {
            "version": "0.9.0",
            "title": "panel.toml",
            "path": "jobs/panel.toml",
            "source": self.options.source,
            "width": self.width,
            "height": self.height,
            "film": film,
            "render": render,
            "error": self.settings.get("error"),
            "notes": [
                {
                    "level": "warning",
                    "text": "1.2 % of the light passes two covers, which no path connects.",
                    "help": "The image is darker there by at most 0.4 DN.",
                },
                {"level": "info", "text": 'The mesh "<b>bolt</b>" has 12 open edges.', "help": None},
            ],
            "curve": curve,
            "forecast": forecast,
            "forecast_from": "plan" if forecast else "points",
            "max_spp": MAX_SPP,
            "prepared": self.settings["prepared"],
            "target": self.target,
            "certificate": certificate,
            "statistics_of": {
                **self.statistics_of,
                "noise": "plain",
                "denoise": "off",
                "device": 0,
                **({"gain": 77} if self.settings["other_camera"] else {}),
            },
            "sensors": SENSORS,
            "camera": {**JOB_CAMERA, "exposure": self.settings["exposure"]},
            "ranges": RANGES,
            "frame": self.settings["frame"],
            "timed": self.settings["timed"],
            "lens": {"f_number": 4.0, "glare": 0.01, "fixed": self.settings["fixed"]},
            "scene": scene,
            "saved": self.saved,
        }

    # Film ----------------------------------------------------------------------------------------
    def need_film(self):
        film = self.film()
        if film is None or self.settings["no_picture"]:
            raise Fault(409, "There is no picture yet.", None, "Wait for the first picture.")
        return film

    def signal(self, camera, film):
        """Electrons of the film and their standard deviation by the render, exposure."""
        sensor = next((s for s in SENSORS if s["name"] == camera["sensor"]), SENSORS[0])
        factor = 1.0
        if camera["lights"]:
            factor = sum(camera["lights"].values()) / max(1, len(camera["lights"]))
        power = sum(light["factor"] * light["on"] for light in self.lights.values()) / len(self.lights)
        factor *= power
        auto = 0.8 * sensor["saturation"] / (self.radiance.max() * max(factor, 1e-6)) / 1e6
        exposure = camera["exposure"] if camera["exposure"] is not None else float(np.clip(auto, *RANGES["exposure"]))
        electrons = self.radiance * factor * exposure * 1e6
        if camera["vignetting"]:
            y, x = np.mgrid[-1 : 1 : self.height * 1j, -1 : 1 : self.width * 1j]
            electrons = electrons * (1 - 0.18 * (x * x + y * y))
        camera_variance = electrons + sensor["dark_noise"] ** 2
        level = self.level(max(0.4, film["seconds"]))
        ratio = level * 0.42 * self.noise * (0.35 if camera["denoise"] != "off" else 1.0)
        return sensor, exposure, electrons, np.sqrt(camera_variance), ratio * np.sqrt(camera_variance)

    def expose(self, camera, frame, film):
        sensor, exposure, electrons, camera_sigma, render_sigma = self.signal(camera, film)
        content = np.random.default_rng(film["id"]).standard_normal(electrons.shape)
        got = electrons + render_sigma * content
        if film["first"]:
            got = np.repeat(np.repeat(got[::8, ::8], 8, 0), 8, 1)[: self.height, : self.width]
        pattern = np.random.default_rng(1000 + camera["device"]).standard_normal(electrons.shape)
        got = got * (1 + 0.004 * pattern)
        if camera["noise"] != "none":
            spread = camera_sigma
            if camera["noise"] == "matched":
                spread = np.sqrt(np.maximum(0, camera_sigma**2 - render_sigma**2))
            got = got + spread * np.random.default_rng(frame * 7919 + camera["device"]).standard_normal(electrons.shape)
        white = 2 ** sensor["bits"] - 1
        black = camera["black_level"] if camera["black_level"] is not None else (white + 1) // 64
        gain = (white - black) / sensor["saturation"] * camera["gain"]
        dn = np.clip(np.rint(black + gain * np.maximum(got, -50)), 0, white)
        matched = float(np.mean(render_sigma <= camera_sigma)) if camera["noise"] == "matched" else None
        return {
            "sensor": sensor,
            "exposure": exposure,
            "electrons": electrons,
            "camera_sigma": camera_sigma,
            "render_sigma": render_sigma,
            "white": white,
            "black": black,
            "gain": gain,
            "dn": dn,
            "matched": matched,
        }

    def check_camera(self, camera):
        if not isinstance(camera, dict) or set(camera) != CAMERA_KEYS:
            raise Fault(400, f"The camera must have the keys {sorted(CAMERA_KEYS)}.")
        if (
            camera["exposure"] is not None
            and not RANGES["exposure"][0] * 0.999 <= camera["exposure"] <= RANGES["exposure"][1] * 1.001
        ):
            raise Fault(
                422, f"The exposure of {camera['exposure']} s is out of range.", "exposure", "Use 10 us to 1 s."
            )
        if camera["denoise"] == "oidn":
            raise Fault(
                422,
                "Open Image Denoise is not installed.",
                "denoise",
                "Install the library, or use the built-in filter.",
            )
        if camera["noise"] not in ("plain", "matched", "none") or not isinstance(camera["device"], int):
            raise Fault(400, "The noise or the device is invalid.")
        factors = (camera["lights"] or {}).values()
        if not self.per_light and any(factor != 1 for factor in factors):
            raise Fault(422, "There is one film for all lights.", "lights", None)
        if not all(0 <= factor <= 1e6 for factor in factors):
            raise Fault(422, "The factor of a light is out of range.", "lights", "Use 0 to 1000000.")
        if camera["sensor"] is not None and camera["sensor"] not in [s["name"] for s in SENSORS]:
            raise Fault(422, f"There is no sensor {camera['sensor']}.", "sensor", None)
        return camera

    # Answers -------------------------------------------------------------------------------------
    def frame(self, body):
        camera = self.check_camera(body["camera"])
        if set(body) != {"camera", "frame", "tone", "statistics"} or body["tone"] not in ("gamma", "linear", "log"):
            raise Fault(400, "The frame needs camera, frame, tone and statistics.")
        if body["statistics"]:
            self.statistics_of = camera
        begin, film = time.time(), self.need_film()
        shot = self.expose(camera, body["frame"], film)
        colour = camera["sensor"] is None or shot["sensor"]["colour"]
        header = {
            "width": self.width,
            "height": self.height,
            "format": "rgb8" if colour else "gray16",
            "white": shot["white"],
            "black": shot["black"],
            "film": film["id"],
            "exposure": shot["exposure"],
            "no_light": False,
            "is_black": self.settings["black"],
            "saturated": self.settings["saturated"] or float(np.mean(shot["dn"] >= shot["white"])),
            "matched": shot["matched"],
            "analysis": self.settings["analysis"],
            "mean_value": float(shot["dn"].mean()),
            "mean_electrons": float(shot["electrons"].mean()),
            "compute": time.time() - begin,
        }
        if colour:
            share = np.clip(shot["dn"] / shot["white"], 0, 1)
            curve = {"gamma": share ** (1 / 2.2), "linear": share, "log": np.log1p(1000 * share) / math.log(1001)}[
                body["tone"]
            ]
            tint = np.array([1.0, 0.97, 0.9])
            data = np.rint(255 * np.clip(curve[..., None] * tint, 0, 1)).astype(np.uint8).tobytes()
        else:
            data = shot["dn"].astype("<u2").tobytes()
        return header, data

    def map(self, body):
        camera = self.check_camera(body["camera"])
        if set(body) != {"camera", "map"} or body["map"] not in MAPS:
            raise Fault(400, "The map is invalid.")
        begin, film = time.time(), self.need_film()
        shot = self.expose(camera, 0, film)
        ratio = shot["render_sigma"] / shot["camera_sigma"]
        spp = film["spp"] * (0.4 + self.noise)
        name = body["map"]
        values, unit = {
            "ratio": (ratio, ""),
            "samples": (np.rint(spp), "samples"),
            "recent": (np.rint(12 * self.noise), "samples"),
            "first_light": (60 + 40 * self.radiance / self.radiance.max(), "%"),
            "render_sigma": (shot["render_sigma"] * shot["gain"], "DN"),
            "camera_sigma": (shot["camera_sigma"] * shot["gain"], "DN"),
        }[name]
        values = values.astype(np.float32)
        if name == "samples" and self.settings["samples"]:
            values[:] = self.settings["samples"]
        if name == "ratio":
            values[shot["dn"] >= shot["white"]] = np.nan
            values[:12, :12] = np.inf
        known = values[np.isfinite(values)]
        low, high = np.quantile(known, [0.01, 0.99])
        return {
            "width": self.width,
            "height": self.height,
            "format": "f32",
            "unit": unit,
            "film": film["id"],
            "compute": time.time() - begin,
            "low": float(low),
            "high": float(high),
        }, values.astype("<f4").tobytes()

    def probe(self, body):
        camera, film = self.check_camera(body["camera"]), self.need_film()
        x, y = body["x"], body["y"]
        if not (0 <= x < self.width and 0 <= y < self.height):
            raise Fault(422, "The pixel is not on the film.")
        shot = self.expose(camera, body["frame"], film)
        names = [
            (None, None),
            ("front panel", "anodised aluminium"),
            ("screw M3 (7)", "steel, turned"),
            ("window of the display", "PMMA cover <clear>"),
        ]
        name, material = names[self.objects[y, x]]
        at = lambda plane: float(plane[y, x])
        return {
            "x": x,
            "y": y,
            "channel": BAYER[y % 2][x % 2] if shot["sensor"]["colour"] and camera["sensor"] else None,
            "value": at(shot["dn"]),
            "electrons": at(shot["electrons"]),
            "radiance": [at(self.radiance)] * 3,
            "camera_sigma": at(shot["camera_sigma"]) * shot["gain"],
            "render_sigma": at(shot["render_sigma"]) * shot["gain"],
            "ratio": at(shot["render_sigma"] / shot["camera_sigma"]),
            "samples": None if self.options.source == "exr" else int(film["spp"] * (0.4 + at(self.noise))),
            "object": name,
            "material": material,
            "depth": 0.412 + 0.0001 * x if name else None,
            "heaviest": {"index": 1174, "share": 0.043} if name else None,
        }

    def regions(self, body):
        camera, film = self.check_camera(body["camera"]), self.need_film()
        if not 1 <= len(body["regions"]) <= 2 or set(body) != {"camera", "frame", "regions", "channel"}:
            raise Fault(400, "1 or 2 regions are allowed.")
        if self.settings["regions"]:
            raise Fault(422, self.settings["regions"])
        shot, inside, found = self.expose(camera, body["frame"], film), [], []
        is_meant = self.filter_of(camera, body["channel"])
        for x0, y0, x1, y1 in body["regions"]:
            if not (0 <= x0 < x1 <= self.width and 0 <= y0 < y1 <= self.height):
                raise Fault(422, "A region is not on the film.")
            inside.append(shot["dn"][y0:y1, x0:x1][is_meant[y0:y1, x0:x1]])
            if inside[-1].size == 0:
                raise Fault(422, "The region contains no pixel.")
        low, span = min(dn.min() for dn in inside), max(dn.max() for dn in inside) - min(dn.min() for dn in inside) + 1
        for dn in inside:
            width = math.ceil(span / 64)
            counts = np.bincount(((dn - low) // width).astype(int), minlength=math.ceil(span / width))
            found.append(
                {
                    "pixels": int(dn.size),
                    "mean": float(dn.mean()),
                    "variance": float(dn.var()),
                    "min": float(dn.min()),
                    "max": float(dn.max()),
                    "snr": float((dn.mean() - shot["black"]) / dn.std()) if dn.std() > 0 else None,
                    "saturated": float(np.mean(dn >= shot["white"])),
                    "histogram": {"low": float(low), "width": width, "counts": counts.tolist()},
                }
            )
        contrast = found[0]["mean"] - found[1]["mean"] if len(found) == 2 else None
        cnr = None if contrast is None else abs(contrast) / float(shot["camera_sigma"].mean() * shot["gain"])
        return {"regions": found, "contrast": contrast, "cnr": cnr}

    def filter_of(self, camera, channel):
        """True for the pixels of a colour; all pixels without one."""
        everywhere = np.ones((self.height, self.width), bool)
        if channel is None:
            return everywhere
        sensor = next((s for s in SENSORS if s["name"] == camera["sensor"]), None)
        if not sensor or not sensor["colour"]:
            raise Fault(422, "The sensor has no colour filter.")
        tiles = np.array(BAYER) == channel
        return np.tile(tiles, (self.height // 2 + 1, self.width // 2 + 1))[: self.height, : self.width]

    def line(self, body):
        camera, film = self.check_camera(body["camera"]), self.need_film()
        if set(body) != {"camera", "frame", "from", "to", "channel"}:
            raise Fault(400, "The line needs camera, frame, from, to and channel.")
        self.filter_of(camera, body["channel"])
        for x, y in (body["from"], body["to"]):
            if not (0 <= x < self.width and 0 <= y < self.height):
                raise Fault(422, "The line leaves the image.")
        shot = self.expose(camera, body["frame"], film)
        (x0, y0), (x1, y1) = body["from"], body["to"]
        count = max(abs(x1 - x0), abs(y1 - y0)) + 1
        xs = np.rint(np.linspace(x0, x1, count)).astype(int)
        ys = np.rint(np.linspace(y0, y1, count)).astype(int)
        pick = lambda plane: plane[ys, xs].tolist()
        return {
            "values": pick(shot["dn"]),
            "expected": pick(np.clip(shot["black"] + shot["gain"] * shot["electrons"], 0, shot["white"])),
            "sigma": pick(shot["gain"] * shot["camera_sigma"]),
            "length": math.hypot(x1 - x0, y1 - y0),
        }

    def path(self, body):
        self.check_camera(body["camera"])
        x, y = body["x"], body["y"]
        keys = ("before", "luminance", "x", "y", "object", "event")
        vertices = [
            (None, 0.01, x + 0.5, y + 0.5, "front panel", "diffuse reflection"),
            (0, 0.0, self.width * 0.62, self.height * 0.3, "window of the display", "specular transmission"),
            (1, 0.0, None, None, "lens hood", "diffuse reflection"),
            (0, 0.0, self.width * 0.3, self.height * 0.2, "screw M3 (2)", "glossy reflection"),
            (3, 3.8, self.width * 0.5, self.height * 0.05, "ring light", "emission"),
        ]
        return {
            "index": body["index"] if body["index"] is not None else 1174,
            "luminance": 3.81,
            "vertices": [dict(zip(keys, vertex, strict=True)) for vertex in vertices],
        }

    def photon_transfer(self, body):
        camera, film = self.check_camera(body["camera"]), self.need_film()
        shot = self.expose(camera, 0, film)
        generator = np.random.default_rng(film["id"])
        electrons = np.linspace(0, 0.9 * shot["sensor"]["saturation"], 40)
        mean = shot["black"] + shot["gain"] * electrons
        variance = (
            shot["gain"] ** 2
            * (electrons + shot["sensor"]["dark_noise"] ** 2)
            * (1 + 0.04 * generator.standard_normal(40))
        )
        slope, offset = np.polyfit(mean, variance, 1)
        return {
            "points": [{"mean": float(m), "variance": float(v)} for m, v in zip(mean, variance)],
            "gain": shot["gain"],
            "line": {"slope": float(slope), "offset": float(offset)},
            "dark": float(shot["black"]),
        }

    def lights_on(self):
        return sum(light["on"] for light in self.lights.values())

    def restart(self):
        self.film_offset = (self.film() or {"id": self.film_offset})["id"]
        self.begin, self.restarted, self.paused = time.time(), self.restarted + 1, False

    def scene(self, body):
        if self.options.source != "render":
            raise Fault(422, "Nothing renders here.")
        if not body or set(body) - {"camera", "lights", "effects", "materials", "per_light"}:
            raise Fault(400, "The change of the scene is invalid.")
        if body.get("per_light") and self.lights_on() == 0:
            raise Fault(422, "No light is on, so there is nothing to give a film to.", None, "Switch a light on.")
        with self.lock:
            self.camera_name = body.get("camera", self.camera_name)
            for name, light in body.get("lights", {}).items():
                if set(light) != {"on", "factor"}:
                    raise Fault(400, "A light needs on and factor.")
                self.lights[name] = light
            for name, is_on in body.get("effects", {}).items():
                self.left_out = self.left_out - {name} if is_on else self.left_out | {name}
            for name, change in body.get("materials", {}).items():
                material = next(m for m in self.materials if m["name"] == name)
                material.update(change, changed={**material["changed"], **change})
            self.per_light = body.get("per_light", self.per_light)
            self.restart()
        return {}

    def render(self, body):
        action = body["action"]
        if action == "pause":
            self.paused_at, self.paused = self.seconds(), True
        elif action == "resume":
            self.begin, self.paused = time.time() - self.paused_at / self.options.speed, False
        elif action == "restart":
            self.restart()
        else:
            raise Fault(400, "The action is unknown.")
        return {}

    def set_target(self, body):
        if not 0.05 <= body["k"] <= 4:
            raise Fault(422, "k must be 0.05 to 4.")
        self.target = body["k"]
        return {}

    def save(self, body):
        self.check_camera(body["camera"])
        ends = {"png": ".png", "tiff": ".tif", "exr": ".exr", "film": ".film", "job": ".toml"}
        files = [body["name"] + ends[what] for what in body["what"]]
        for file in files:
            if file in [*self.saved, "panel.toml"]:
                raise Fault(422, f"The file {file} exists.", file, "Choose another name.")
        self.saved = self.saved + files
        return {"files": files, "note": None}
