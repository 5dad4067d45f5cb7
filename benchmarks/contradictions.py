"""Count the results that state something and deny it elsewhere.

    python -m benchmarks contradictions RESULTS

RESULTS is a folder with results of photos, such as ``physic batch`` writes. Prints each
contradiction, then how many of the results have one; ends with 1 if any has.
"""

from __future__ import annotations

from pathlib import Path

from physic_batch.contact_sheet import find_results
from physic_core import load_reconstruction
from physic_testing.contradictions import contradictions

from .fits import parser_of


def main() -> int:
    """Check all results below a folder."""
    parser = parser_of("contradictions", __doc__, fits=False)
    parser.add_argument("results", type=Path, help="folder with results")
    folders = find_results(parser.parse_args().results)
    sentences_of = {folder: contradictions(load_reconstruction(folder)) for folder in folders}
    for folder, sentences in sentences_of.items():
        for sentence in sentences:
            print(f"{folder.name}: {sentence}")
    wrong = sum(map(bool, sentences_of.values()))
    print(f"{wrong} of {len(sentences_of)} results contradict themselves")
    return int(wrong > 0)
