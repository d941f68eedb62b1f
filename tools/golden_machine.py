"""What the last digits of results depend on besides the code: the processor as compilers see it, and the libraries."""

from __future__ import annotations

import platform
import sys

import cv2  # noqa: F401 like scipy.linalg: brings an OpenBLAS of its own, which threadpoolctl sees once it is loaded
import llvmlite.binding
import numba
import scipy.linalg  # noqa: F401
import threadpoolctl

from anchorpose.versions import LIBRARIES, versions


def fingerprint() -> dict[str, str]:
    """By name. Two machines with the same fingerprint give the same bytes."""
    host = llvmlite.binding.get_host_cpu_features()
    cores = {pool["architecture"] for pool in threadpoolctl.threadpool_info() if pool["internal_api"] == "openblas"}
    return {
        "processor": numba.config.CPU_NAME or llvmlite.binding.get_host_cpu_name(),
        "features": numba.config.CPU_FEATURES or " ".join(sorted(name for name, has in host.items() if has)),
        "openblas": " ".join(sorted(cores)),
        "libc": " ".join(platform.libc_ver()),  # compiled kernels call its sine and logarithm
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        **{name: versions()[name] for name in LIBRARIES},
        "llvmlite": llvmlite.__version__,
    }
