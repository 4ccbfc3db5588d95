"""Converts the tables of a submission from CSV to Parquet: ``python pack.py FOLDER SUBMISSION``."""

import sys
from pathlib import Path

import pandas as pd

DECIMALS = 10
"""Decimals of all numbers: those of the truths of the benchmark."""


def pack(folder: Path, submission: Path) -> None:
    """Write each CSV file of a folder as a Parquet file of the submission, with rounded numbers."""
    for file in sorted(folder.glob("*.csv")):
        table = pd.read_csv(file).round(DECIMALS)
        # Accelerations follow from the motion, and are not needed for a verdict.
        columns = [name for name in table if not name.endswith((".ax", ".ay", ".alpha"))]
        table[columns].to_parquet(submission / f"{file.stem}.parquet", compression="zstd")


if __name__ == "__main__":
    pack(Path(sys.argv[1]), Path(sys.argv[2]))
