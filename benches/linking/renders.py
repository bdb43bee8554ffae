"""Renders a scene many times from one load, as `examples/renders.rs`: python renders.py SCENE RENDERS SIDE SPP."""

import sys
import time

import dunkelfeld

scene, renders, side, spp = dunkelfeld.Scene(sys.argv[1]), *map(int, sys.argv[2:5])
for round in range(1, 4):
    began, total = time.perf_counter(), 0.0
    for seed in range(renders):
        total += float(scene.render(width=side, height=side, spp=spp, seed=seed).mean[0, 0, 0])
    print(f"round {round}: {time.perf_counter() - began:.4f} s, sum {total:.6f}")
