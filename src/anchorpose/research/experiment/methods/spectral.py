"""Descriptors from the surface's spectrum that the paper compares with: HKS, scale-invariant HKS, WKS (Section V)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from anchorpose.research.experiment.method import DescriptorSetting, Family, Method, by_descriptor
from anchorpose.research.features.nearest import Metric
from anchorpose.research.features.spectral_signatures import (
    HksConfig,
    SiHksConfig,
    Spectrum,
    WksConfig,
    hks,
    si_hks,
    spectrum,
    wks,
)
from anchorpose.tracker.observation import Observation


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectralConfig:
    """A signature's own configuration and the spectrum that it is made from; logarithm: compared by order of size."""

    signature: Any
    pairs: int = 100  # more do not match better, and cost more
    logarithm: bool = False


Signature = Callable[[Spectrum, Any], np.ndarray]


def _described(signature: Signature) -> Callable[[Observation, SpectralConfig], np.ndarray]:
    def describe(seen: Observation, config: SpectralConfig) -> np.ndarray:
        found = signature(spectrum(seen.surface, config.pairs), config.signature)
        if not config.logarithm:
            return found
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.log(np.where(found > 0, found, np.nan)))

    return describe


def _method(
    key: str, title: str, source: str, signature: Signature, configs: tuple[Any, ...], logarithms: tuple[bool, ...]
) -> Method:
    settings = tuple(
        DescriptorSetting(
            config=SpectralConfig(signature=config, pairs=pairs, logarithm=logarithm), metric=Metric.MANHATTAN
        )
        for config in configs
        for pairs in (100, 150)
        for logarithm in logarithms
    )
    return Method(
        key=key,
        title=title,
        family=Family.SPECTRAL,
        source=source,
        settings=settings,
        associate=by_descriptor(_described(signature)),
        frame_ms=200.0,
    )


METHODS = (
    _method(
        "hks", "heat kernel signature", "Sun et al. 2009, doi:10.1111/j.1467-8659.2009.01515.x", hks,
        (HksConfig(), HksConfig(scaled=False), HksConfig(scaled=False, range_m2=(1e-3, 0.03))), (True, False),
    ),
    _method(
        "si-hks", "scale-invariant HKS", "Bronstein and Kokkinos 2010, doi:10.1109/CVPR.2010.5539838", si_hks,
        (SiHksConfig(), SiHksConfig(frequencies=12)), (False,),
    ),
    _method(
        "wks", "wave kernel signature", "Aubry et al. 2011, doi:10.1109/ICCVW.2011.6130444", wks,
        (WksConfig(), WksConfig(width_steps=3.0)), (True, False),
    ),
)  # fmt: skip
