"""Atomic writes, npz archives with verified checksums, and JSON with non-finite numbers.

Other packages use :mod:`.atomic` for files that are written completely or not at all, files that
may be replaced and files of unknown origin, :mod:`.names` for names of unknown origin,
:mod:`.plain` for dataclasses, :mod:`.npz` for arrays, :mod:`.text` for text and JSON,
:mod:`.values` for what a parsed file of another program holds, and :mod:`.image_file` for photos.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.lazy import importer

if TYPE_CHECKING:
    from physic_core.files.atomic import MARK as MARK
    from physic_core.files.atomic import atomic_write as atomic_write
    from physic_core.files.atomic import check_own as check_own
    from physic_core.files.atomic import check_regular as check_regular
    from physic_core.files.atomic import check_writable as check_writable
    from physic_core.files.atomic import foreign_file as foreign_file
    from physic_core.files.atomic import has_mark as has_mark
    from physic_core.files.atomic import open_regular as open_regular
    from physic_core.files.atomic import open_to_append as open_to_append
    from physic_core.files.atomic import path_to_write as path_to_write
    from physic_core.files.atomic import read_regular as read_regular
    from physic_core.files.atomic import read_text as read_text
    from physic_core.files.atomic import unreadable as unreadable
    from physic_core.files.atomic import write_own as write_own
    from physic_core.files.image_file import IMAGE_SUFFIXES as IMAGE_SUFFIXES
    from physic_core.files.image_file import ImageSource as ImageSource
    from physic_core.files.image_file import decode as decode
    from physic_core.files.image_file import open_image as open_image
    from physic_core.files.image_file import wrap_decoding_errors as wrap_decoding_errors
    from physic_core.files.names import UntrustedName as UntrustedName
    from physic_core.files.names import paths_inside as paths_inside
    from physic_core.files.npz import read_arrays as read_arrays
    from physic_core.files.npz import read_names as read_names
    from physic_core.files.npz import write_arrays as write_arrays
    from physic_core.files.serialization import DamagedFileError as DamagedFileError
    from physic_core.files.serialization import read_value as read_value
    from physic_core.files.serialization import split as split
    from physic_core.files.serialization import write_value as write_value
    from physic_core.files.text import csv_writer as csv_writer
    from physic_core.files.text import finite as finite
    from physic_core.files.text import from_json as from_json
    from physic_core.files.text import parse_json as parse_json
    from physic_core.files.text import parse_toml as parse_toml
    from physic_core.files.text import path_problem as path_problem
    from physic_core.files.text import printable as printable
    from physic_core.files.text import quoted as quoted
    from physic_core.files.text import read_csv as read_csv
    from physic_core.files.text import shorten as shorten
    from physic_core.files.text import to_json as to_json
    from physic_core.files.text import whole as whole
    from physic_core.files.text import write_csv as write_csv
    from physic_core.files.values import boolean as boolean
    from physic_core.files.values import count as count
    from physic_core.files.values import entries as entries
    from physic_core.files.values import identity as identity
    from physic_core.files.values import matrix as matrix
    from physic_core.files.values import number as number

_NAMES = {
    "atomic": "MARK atomic_write check_own check_regular check_writable foreign_file has_mark "
    "open_regular open_to_append path_to_write read_regular read_text unreadable write_own",
    "image_file": "IMAGE_SUFFIXES ImageSource decode open_image wrap_decoding_errors",
    "names": "UntrustedName paths_inside",
    "npz": "read_arrays read_names write_arrays",
    "serialization": "DamagedFileError read_value split write_value",
    "text": "csv_writer finite from_json parse_json parse_toml path_problem printable quoted "
    "read_csv shorten to_json whole write_csv",
    "values": "boolean count entries identity matrix number",
}

__getattr__ = importer(__name__, _NAMES)
