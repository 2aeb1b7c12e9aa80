"""Photographs that are not in memory: what a fit of them gives is lazy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from xarray import Dataset


class Deferred(ABC):
    """What the public functions need of photographs that they cannot fit at once.

    The class that does the work, :class:`impasto.LazyStack`, lies above these functions.
    """

    @abstractmethod
    def fitted_sbrdf(self, **options: Any) -> Dataset:
        """See :func:`impasto.fit_sbrdf`."""

    @abstractmethod
    def fitted_normals(self, **options: Any) -> Dataset:
        """See :func:`impasto.fit_normals`."""

    @abstractmethod
    def applied(self, model: Any, threads: int | None) -> Dataset:
        """See :meth:`impasto.LearnedModel.apply`."""
