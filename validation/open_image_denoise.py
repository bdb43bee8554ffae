"""Intel Open Image Denoise by its C interface, from the library of the package `oidn` or another one."""

from __future__ import annotations

import ctypes
import importlib.util
from pathlib import Path

import numpy as np

FLOAT3 = 3


def packaged_library() -> Path:
    """The library in the package `oidn` of PyPI (version 1.4.3 of the denoiser)."""
    package = importlib.util.find_spec("oidn")
    if package is None or package.origin is None:
        raise SystemExit("the package oidn is not installed: pip install oidn==0.2.1, or give --oidn")
    return next(Path(package.origin).parent.rglob("libOpenImageDenoise.so*"))


class Denoiser:
    """The filter `RT` for images of high dynamic range, with albedo and normal."""

    def __init__(self, library: Path):
        # Version 1.4.3 needs a library beside it that the loader does not find.
        for threads in library.parent.glob("libtbb.so.12*"):
            ctypes.CDLL(str(threads), mode=ctypes.RTLD_GLOBAL)
        self.library = ctypes.CDLL(str(library))
        pointer, text, size = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t
        signatures = {
            "NewDevice": ([ctypes.c_int], pointer),
            "CommitDevice": ([pointer], None),
            "GetDeviceError": ([pointer, ctypes.POINTER(text)], ctypes.c_int),
            "NewFilter": ([pointer, text], pointer),
            "SetSharedFilterImage": ([pointer, text, pointer, ctypes.c_int, size, size, size, size, size], None),
            "SetFilter1b": ([pointer, text, ctypes.c_bool], None),
            "CommitFilter": ([pointer], None),
            "ExecuteFilter": ([pointer], None),
            "ReleaseFilter": ([pointer], None),
        }
        for name, (arguments, result) in signatures.items():
            function = getattr(self.library, f"oidn{name}")
            function.argtypes, function.restype = arguments, result
        self.device = self.library.oidnNewDevice(0)
        self.library.oidnCommitDevice(self.device)
        self._check()

    def _check(self) -> None:
        message = ctypes.c_char_p()
        if self.library.oidnGetDeviceError(self.device, ctypes.byref(message)) != 0:
            raise SystemExit(f"Open Image Denoise: {(message.value or b'').decode()}")

    def __call__(self, color: np.ndarray, albedo: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """The denoised radiance; all images are (rows, columns, 3)."""
        height, width, _ = color.shape
        images = {
            name: np.ascontiguousarray(image, dtype=np.float32)
            for name, image in (("color", color), ("albedo", albedo), ("normal", normal), ("output", np.zeros(color.shape)))
        }
        job = self.library.oidnNewFilter(self.device, b"RT")
        for name, image in images.items():
            self.library.oidnSetSharedFilterImage(job, name.encode(), image.ctypes.data, FLOAT3, width, height, 0, 0, 0)
        self.library.oidnSetFilter1b(job, b"hdr", True)
        self.library.oidnCommitFilter(job)
        self.library.oidnExecuteFilter(job)
        self.library.oidnReleaseFilter(job)
        self._check()
        return images["output"]
