"""Every figure of a preset has a source, or is named assumed with the reason."""

from importlib.resources import files

import pytest
import yaml

from trackbench.models.sensors import Lidar, Radar
from trackbench.models.sensors.presets import Preset, list_presets, presets

CLASSES = {"radar": Radar, "lidar": Lidar}


def test_the_sensors_with_published_figures_are_there() -> None:
    radars = {"bosch_lrr3", "continental_ars30x", "continental_ars548", "smartmicro_umrr"}
    assert set(presets()) == radars | {"ouster_os1", "velodyne_vlp16"}


@pytest.mark.parametrize("preset", list_presets(), ids=lambda preset: preset.name)
def test_preset(preset: Preset) -> None:
    sensor = CLASSES[preset.kind](preset=preset.name)

    assert {key: sensor.model_dump()[key] for key in preset.values} == preset.values
    assert preset.title
    assert preset.source
    text = files("trackbench.models.sensors").joinpath("presets.yaml").read_text(encoding="utf-8")
    figures = yaml.safe_load(text)[preset.name]["values"]
    sources = {key: figure["source"] for key, figure in figures.items() if "source" in figure}
    assert set(sources) | set(preset.assumed) == set(preset.values)
    assert not set(sources) & set(preset.assumed)
    assert all(len(reason) > 10 for reason in (*sources.values(), *preset.assumed.values()))


def test_a_key_that_is_given_wins() -> None:
    assert Lidar(preset="ouster_os1", position_sigma_m=0.2).position_sigma_m == 0.2


def test_a_preset_of_the_other_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="no radar preset has the name 'ouster_os1'"):
        Radar(preset="ouster_os1")
