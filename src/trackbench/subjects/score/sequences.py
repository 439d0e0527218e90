"""The sequences that are scored: which file of tracks belongs to which file of boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from trackbench.base.errors import InputError, counted, nearest_choices
from trackbench.truth.config.logs import is_log, log_names
from trackbench.truth.tracks import TRAFFIC_FORMATS


class Sequences(NamedTuple):
    """Files of boxes, and of each tracker one file of tracks for each of them."""

    name: str
    """Of all together."""
    truth: list[Path]
    trackers: list[Path]
    """The file or the folder that each tracker is named after."""
    tracks: list[list[Path]]
    """By tracker, its files in the order of ``truth``."""


def paired_sequences(
    tracks: Sequence[Path], truth: Sequence[Path], form: str | None = None, truth_form: str | None = None
) -> Sequences:
    """Pair files of tracks with files of boxes.

    With one file of boxes each file of tracks is a tracker. Otherwise a folder of tracks is a tracker, and so are all
    files of tracks together. Files belong together by their names without the ending.

    Args:
        tracks: files or folders.
        truth: files or folders, of which every file is a sequence.
        form, truth_form: the format of the tracks and of the boxes, if it is stated: files with its endings count in a
            folder, or all where none has one.

    Raises:
        InputError: a file or folder is not there, or a file has no partner.
    """
    for path in (*tracks, *truth):
        if not path.exists():
            beside = [each.name for each in path.parent.iterdir()] if path.parent.is_dir() else []
            raise InputError(f"there is no such file; {nearest_choices(path.name, beside)}", file=path)
    folders = [path for path in tracks if _is_folder(path)]
    if len(truth) == 1 and not _is_folder(truth[0]) and not folders:
        return Sequences(truth[0].stem, [*truth], [*tracks], [[file] for file in tracks])
    boxes = _by_name(truth, truth_form)
    if folders and len(folders) < len(tracks):
        raise InputError("a folder of tracks is a tracker: name folders alone, or files alone", file=folders[0])
    if not folders and len(tracks) != len(boxes):
        counts = f"{counted(len(tracks), 'file')} of tracks and {len(boxes)} of boxes"
        raise InputError(f"{counts}: one for each; of several trackers name a folder for each", key="--truth")
    own = {path: _by_name([path], form) for path in folders} or {tracks[0].parent: _by_name(tracks, form)}
    place = truth[0] if _is_folder(truth[0]) else truth[0].parent
    for folder, files in own.items():
        _require_pairs(files, boxes, folder, place)
    trackers = [folder.absolute().parent if folder.name == "data" else folder.absolute() for folder in own]
    tracked = [[files[name] for name in boxes] for files in own.values()]
    return Sequences(place.absolute().name, [*boxes.values()], trackers, tracked)


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not is_log(path)


def _by_name(paths: Sequence[Path], form: str | None) -> dict[str, Path]:
    """The files by the name of their sequence, those of folders among them."""
    files: dict[str, Path] = {}
    single = [path for path in paths if not _is_folder(path)]
    stems = [path.stem for path in single]
    names = dict(zip(single, stems if len({*stems}) == len(stems) else log_names([*map(str, single)]), strict=True))
    for path in paths:
        for name, file in _in_folder(path, form) if _is_folder(path) else [(names[path], path)]:
            if name in files:
                raise InputError(f"{name} is a sequence already, in {files[name]}", file=file)
            files[name] = file
    return files


def _in_folder(folder: Path, form: str | None) -> list[tuple[str, Path]]:
    """The files of a folder, or of ``data`` in it; else ``gt/gt.txt`` in each folder, as MOTChallenge has it.

    Of a stated format they are those with its endings; where there is none, all are of it.
    """
    place = folder / "data" if (folder / "data").is_dir() else folder
    formats = TRAFFIC_FORMATS.loaded()
    possible = [formats[form]] if form in formats else formats.values()
    endings = tuple(sorted({ending for each in possible for ending in each.endings}))
    every = [file for file in sorted(place.glob("[!.]*")) if is_log(file)]
    files = [file for file in every if file.name.lower().endswith(endings)] or (every if form in formats else [])
    by_name = [(file.stem, file) for file in files] or [
        (file.parents[1].name, file) for file in sorted(folder.glob("*/gt/gt.txt"))
    ]
    if not by_name:
        raise InputError(
            f"a folder that is no bag of ROS 2, and no file in it ends in {', '.join(endings)}", file=folder
        )
    return by_name


def _require_pairs(tracks: Mapping[str, Path], boxes: Mapping[str, Path], where: Path, truth: Path) -> None:
    for what, own, others, file in (("tracks", tracks, boxes, where), ("boxes", boxes, tracks, truth)):
        missing = [name for name in others if name not in own]
        if missing:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            near = nearest_choices(missing[0], [name for name in own if name not in others] or own)
            raise InputError(f"no {what} of the sequence {missing[0]}{more}; {near}", file=file)
