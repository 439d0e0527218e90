"""Latitude and longitude as metres in a plane that touches the ground."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from trackbench.base.config import Config
from trackbench.base.types import Array

#: Of the ellipsoid WGS 84: half of its long axis, m, and its flattening.
SEMI_MAJOR_AXIS, FLATTENING = 6378137.0, 1 / 298.257223563


class GeographicOrigin(Config):
    """A point on the ellipsoid WGS 84 at which a plane touches it."""

    lat_deg: float = Field(ge=-90, le=90, description="Its latitude, degrees, north.")
    lon_deg: float = Field(ge=-180, le=180, description="Its longitude, degrees, east.")

    def plane(self, latitude: Array, longitude: Array) -> tuple[Array, Array]:
        """Return the distances to the east and to the north of the origin of points on the ellipsoid, m.

        Source: Misra and Enge (2011), "Global Positioning System: Signals, Measurements, and Performance", appendix
        4.A: geodetic to earth-centred, and to local east, north and up, which is left out.

        Args:
            latitude, longitude: ``(rows,)`` degrees.
        """
        here = _earth_centred(np.array(self.lat_deg), np.array(self.lon_deg))[:, None]
        dx, dy, dz = _earth_centred(latitude, longitude) - here
        phi, lam = np.radians([self.lat_deg, self.lon_deg])
        away = np.cos(lam) * dx + np.sin(lam) * dy
        return np.cos(lam) * dy - np.sin(lam) * dx, np.cos(phi) * dz - np.sin(phi) * away


def _earth_centred(latitude: Array, longitude: Array) -> Array:
    phi, lam = np.radians(latitude), np.radians(longitude)
    squared = FLATTENING * (2 - FLATTENING)
    normal = SEMI_MAJOR_AXIS / np.sqrt(1 - squared * np.sin(phi) ** 2)
    x, y = (normal * np.cos(phi) * part for part in (np.cos(lam), np.sin(lam)))
    return np.stack([x, y, (1 - squared) * normal * np.sin(phi)])
