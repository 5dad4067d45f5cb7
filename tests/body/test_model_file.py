"""Files of SMPL and MANO that are damaged or made to do harm: each ends in BodyModelError, and none
in a crash.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pickles import As, Name, chumpy, instance, pickled, select
from scipy.sparse import csc_matrix, csr_matrix

from physic_core.body.files import MANO, read_model_file
from physic_core.errors import BodyModelError
from physic_testing.body_files import mano_arrays


@pytest.mark.parametrize(
    ("protocol", "sparse"), [(0, csc_matrix), (2, csc_matrix), (5, csr_matrix)]
)
def test_a_mano_file_is_read_in_its_own_types(tmp_path, protocol, sparse):
    arrays = mano_arrays()
    path = tmp_path / "MANO_RIGHT.pkl"
    axes_turned = np.ascontiguousarray(arrays["shapedirs"].transpose(1, 0, 2)).transpose(1, 0, 2)
    published = {
        **arrays,
        "J_regressor": sparse(arrays["J_regressor"]),
        "posedirs": np.asfortranarray(arrays["posedirs"]),
        "shapedirs": axes_turned,
        "weights": arrays["weights"].astype(">f8"),
        "bs_type": "lrotmin",
        "one": np.float64(1),
    }
    path.write_bytes(pickle.dumps(published, protocol=protocol))
    found = read_model_file(path, MANO)
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        assert_array_equal(found[name], array)
    assert found["f"].dtype == np.uint32
    np.savez_compressed(tmp_path / "MANO_RIGHT.npz", **arrays)
    read = read_model_file(tmp_path / "MANO_RIGHT.npz", MANO)
    assert_array_equal(read["weights"], arrays["weights"])


def array(shape, code, data):
    """An array of numpy that says what it likes about itself."""
    kind = As("numpy", "dtype", (code, False, True), (3, "<", None, None, None, -1, -1, 0))
    made = ("numpy.core.multiarray", "_reconstruct", (Name("numpy", "ndarray"), (0,), b"b"))
    return As(*made, (1, shape, kind, False, data))


def sparse(**changes):
    whole = csc_matrix(np.eye(16, 778))
    state = {
        "_shape": whole.shape,
        "data": whole.data,
        "indices": whole.indices,
        "indptr": whole.indptr,
    } | changes
    return instance("scipy.sparse.csc", "csc_matrix", state)


def chosen(idxs, shape=(778, 3, 10)):
    return select(chumpy(np.zeros(778 * 30)), idxs, shape)


def endless():
    found = chosen(np.zeros(3, int))
    found.called[2]["a"] = found
    return found


FULL = np.arange(778 * 30).reshape(778, 3, 10)
UNFIT = "is an array whose parts do not fit together"
HARM = {
    "row outside": ("J_regressor", lambda: sparse(indices=np.arange(16) + 10**9), UNFIT),
    "fractions for rows": ("J_regressor", lambda: sparse(indices=np.full(16, 0.5)), "by float64, not of numbers"),  # noqa: E501
    "ends outside": ("J_regressor", lambda: sparse(indptr=np.r_[np.zeros(778, int), 10**12]), UNFIT),  # noqa: E501
    "a huge matrix": ("J_regressor", lambda: sparse(_shape=(10**6, 10**6)), "(1000000, 1000000), "
                                                                            "larger than any"),
    "text in a matrix": ("J_regressor", lambda: sparse(data="text"), "is a str, not an array"),
    "a huge array": ("weights", lambda: array((10**12,), "f8", b"12345678"), UNFIT),
    "a hidden axis": ("weights", lambda: array((0, 2**61), "f8", ""), UNFIT),
    "no bytes": ("weights", lambda: array((778, 16), "f8", 10**12), UNFIT),
    "objects": ("weights", lambda: array((10**6,), "O8", []), "holds objects, not numbers"),
    "fields": ("weights", lambda: array((1,), "V999", b"1" * 999), "holds no numbers, not numbers"),
    "complex numbers": ("weights", lambda: np.zeros((778, 16), complex), "weights holds "
                                                                         "complex128, not numbers"),
    "no numbers": ("weights", lambda: np.full((778, 16), np.nan), "weights holds numbers that are "
                                                                  "not finite"),
    "a choice outside": ("shapedirs", lambda: chosen(FULL.ravel() + 1), UNFIT),
    "a huge choice": ("shapedirs", lambda: chosen(FULL.ravel(), (10**9, 10**9)), UNFIT),
    "a choice of itself": ("shapedirs", endless, UNFIT),
    "vertex outside": ("f", lambda: np.full((1538, 3), 778), "f holds 778, not an index below 778"),
    "half a vertex": ("f", lambda: np.full((1538, 3), 0.5), "f holds 0.5, not an index below 778"),
    "parent outside": ("kintree_table", lambda: np.full((2, 16), 16), "kintree_table is not the "
                                                                      "joint tree of MANO"),
}  # fmt: skip


def test_harmful_pickles_end_in_words_and_take_no_memory(tmp_path):
    """In a process of its own: scipy writes beside a matrix whose indices lie outside of it, and
    that may crash.
    """
    for name, (where, make, _) in HARM.items():
        pickled(tmp_path / f"{name}.pkl", {**mano_arrays(), where: make()})
    for (name, words), (path, faults) in zip(
        refused(tmp_path, list(HARM)), HARM.items(), strict=True
    ):
        assert name == path
        assert faults[2] in words, f"{name}: {words}"
        assert words.endswith(MANO.advice), f"{name}: {words}"


NEITHER = "is neither an .npz archive nor a pickle of MANO"
CLAIMS = {
    "BINBYTES8": (b"\x80\x04\x8e" + (3 * 2**30).to_bytes(8, "little") + b"abc.", NEITHER),
    "FRAME": (
        b"\x80\x04\x95" + (2**62).to_bytes(8, "little") + b"}.",
        "lacks the arrays v_template",
    ),
    "BINBYTES8 that is short": (b"\x80\x04}\x8e" + (4).to_bytes(8, "little") + b"0.", NEITHER),
    "escapes": (
        b"\x80\x02cevil\x1b[2J\nred\x1b[31m\n)R.",
        r"asks for 'evil\x1b[2J.red\x1b[31m', which",
    ),
    "a long name": (
        b"\x80\x02c" + b"A" * 5_000_000 + b"\nx\n)R.",
        f"asks for '{'A' * 77}...', which",
    ),
    "a long encoding": (
        b"\x80\x02c_codecs\nencode\n(X\x01\x00\x00\x00aX\x05\x00\x00\x00\x1b[31mtR.",
        r"asks for 'bytes in \x1b[31m', which",
    ),
}  # opcode or fault -> pickle, words


def test_lengths_and_names_of_a_pickle_take_no_memory_and_no_screen(tmp_path):
    for name, (content, _) in CLAIMS.items():
        (tmp_path / f"{name}.pkl").write_bytes(content)
    most = 80 + len(str(tmp_path)) + 250  # a text of the file's, its path, our own words
    for name, words in refused(tmp_path, list(CLAIMS)):
        assert CLAIMS[name][1] in words, f"{name}: {words[:500]}"
        assert words.isprintable(), f"{name}: {words[:500]!r}"
        assert len(words) < most, f"{name}: {len(words)} characters"


def read_apart(code, paths):
    """Lines that a process prints whose code begins with the imports of a reader."""
    imports = """
import sys, tracemalloc
from pathlib import Path
from physic_core.body.files import MANO, read_model_file
from physic_core.errors import BodyModelError
"""
    command = [sys.executable, "-c", imports + code, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


def refused(folder, names, suffix=".pkl"):
    """What each file is refused with, in another process whose arrays take less than 64 MB."""
    code = """
for path in sys.argv[1:]:
    tracemalloc.start()
    try:
        read_model_file(Path(path), MANO)
        print("read")
    except BodyModelError as error:
        print(str(error).replace(chr(10), " "))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64e6, f"{path} takes {peak / 1e6:.0f} MB"
"""
    paths = [folder / f"{name}{suffix}" for name in names]
    return list(zip(names, read_apart(code, paths), strict=True))


def npy(shape, kind, data=b""):
    text = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + data


ARCHIVES = {
    "huge": (npy("(1000000000000, 16)", "'<f8'"), "the file is damaged"),
    "objects": (npy("(778, 16)", "'|O'"), "holds a pickled object where numbers belong"),
    "fields": (
        npy("(778, 16)", "[('a', '|O'), ('b', '<f8')]"),
        "holds a pickled object where numbers belong",
    ),
    "no header": (b"nothing", "the file is damaged"),
    "zeros": (
        npy("(6250000, 2)", "'<f8'", bytes(10**8)),
        ": weights must be (778, 16), got (6250000, 2)",
    ),
}


def test_harmful_archives_end_in_words_and_take_no_memory(tmp_path):
    np.savez(tmp_path / "whole.npz", **{k: v for k, v in mano_arrays().items() if k != "weights"})
    for name, (content, _) in ARCHIVES.items():
        (tmp_path / f"{name}.npz").write_bytes((tmp_path / "whole.npz").read_bytes())
        with zipfile.ZipFile(tmp_path / f"{name}.npz", "a", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("weights.npy", content)
    for name, words in refused(tmp_path, list(ARCHIVES), ".npz"):
        assert ARCHIVES[name][1] in words, f"{name}: {words}"


CALLS = {
    "os.system": b"cos\nsystem\n(X\x04\x00\x00\x00true",
    "builtins.eval": b"cbuiltins\neval\n(X\x03\x00\x00\x001+1",
    "codecs.encode": b"c_codecs\nencode\n(X\x01\x00\x00\x00aX\x05\x00\x00\x00rot13",
    "numpy.load": b"cnumpy\nload\n(X\x01\x00\x00\x00a",
    "an extension": b"\x82\x01(X\x01\x00\x00\x00a",
    "a persistent object": b"X\x01\x00\x00\x00aQ(X\x01\x00\x00\x00a",
}  # what is called -> its pickle, up to the arguments


def test_no_pickle_calls_anything(tmp_path):
    """In a process whose audit hook counts calls of the system, imports, and files that are opened
    for writing.
    """
    for name, opcodes in CALLS.items():
        (tmp_path / f"{name}.pkl").write_bytes(b"\x80\x04" + opcodes + b"tR.")
    code = """
events = []
CALLS = ("os.system", "subprocess.Popen", "exec", "compile", "import", "os.exec", "os.posix_spawn", "socket.connect")
def hook(event, arguments):
    if event in CALLS or (event == "open" and arguments[1] not in ("r", "rb")):
        events.append(event)
sys.addaudithook(hook)
for path in sys.argv[1:]:
    try:
        read_model_file(Path(path), MANO)
    except BodyModelError:
        print(events)
"""  # noqa: E501
    paths = [tmp_path / f"{name}.pkl" for name in CALLS]
    assert read_apart(code, paths) == ["[]"] * len(CALLS)


@pytest.mark.parametrize(
    "state",
    [
        b"ccopy_reg\n_reconstructor\n(N}(X\x05\x00\x00\x00denseX\x01\x00\x00\x00xutb.",
        b"c_codecs\nencode\n(N}(X\x0c\x00\x00\x00__defaults__)utb.",
    ],
)
def test_a_pickle_cannot_change_what_reads_it(tmp_path, state):
    before = read_model_of(tmp_path / "before.pkl")
    (tmp_path / "MODEL.pkl").write_bytes(state)
    with pytest.raises(BodyModelError, match=r"is neither an \.npz archive nor a pickle of MANO"):
        read_model_file(tmp_path / "MODEL.pkl", MANO)
    assert read_model_of(tmp_path / "after.pkl").keys() == before.keys()


def read_model_of(path):
    path.write_bytes(
        pickle.dumps(mano_arrays() | {"J_regressor": csc_matrix(np.eye(16, 778))}, protocol=2)
    )
    return read_model_file(path, MANO)


def test_a_pickle_of_more_than_1_gb_is_not_read(tmp_path):
    with (tmp_path / "a.pkl").open("wb") as file:
        file.truncate(2**30 + 1)
    with pytest.raises(BodyModelError, match="no body model takes more"):
        read_model_file(tmp_path / "a.pkl", MANO)
