"""Holds our pictures against a judge's in block means.

    python tests/judges/compare.py OURS.npy JUDGE.npy [COLUMNS ROWS]

Each file holds one picture (h, w, 3) or several independent ones (n, h, w, 3) of the same raster; the judge's tell its
standard error. A block agrees where it departs by at most 0.2 % of the mean or two standard errors of the judge. Prints
the rms of the departures, what of it the noise of both explains, the part of blocks that agree, the worst in units of that
bound (of the judge alone, its noise taken over all blocks: a few pictures do not tell that of one), and the ratio of means.
"""
import sys

import numpy as np

columns, rows = (int(v) for v in sys.argv[3:5]) if len(sys.argv) > 4 else (32, 24)


def blocks(path):
    pictures = np.load(path).astype(np.float64)
    pictures = pictures[None] if pictures.ndim == 3 else pictures
    n, h, w, _ = pictures.shape
    return pictures.reshape(n, rows, h // rows, columns, w // columns, 3).mean((2, 4))


ours, judge = blocks(sys.argv[1]), blocks(sys.argv[2])
level = judge.mean()


def error_of(pictures):
    n = len(pictures)
    return pictures.std(0, ddof=1) / np.sqrt(n) if n > 1 else np.zeros(pictures.shape[1:])


departs = (ours.mean(0) - judge.mean(0)) / level
theirs, own = error_of(judge) / level, error_of(ours) / level
rms = lambda v: np.sqrt((v * v).mean())
noise = np.hypot(theirs, own)
agree = np.abs(departs) <= np.maximum(0.002, 2 * np.hypot(theirs, own))
systematic = max(rms(departs) ** 2 - rms(noise) ** 2, 0) ** 0.5
bound = max(0.002, 2 * rms(theirs))
worst = np.abs(departs).max()
means, spread = ours.mean((0, 1, 2)) / judge.mean((0, 1, 2)) - 1, error_of(judge.mean((1, 2))) / judge.mean((0, 1, 2))
print(f'{len(ours)} against {len(judge)} pictures, {columns} x {rows} blocks')
print(f'rms of departures {100 * rms(departs):.3f} %, noise of the judge {100 * rms(theirs):.3f} %, ours {100 * rms(own):.3f} %')
print(f'left without noise {100 * systematic:.3f} %; blocks that agree {100 * agree.mean():.1f} % (noise alone: 95 % and more)')
print(f'mean departure {100 * departs.mean():+.3f} %, worst {100 * worst:.3f} %, {worst / bound:.2f} of the bound of {100 * bound:.2f} %')
print('ratio of means - 1:', ' '.join(f'{100 * m:+.3f} %' for m in means), ' two standard errors:', ' '.join(f'{200 * s:.3f} %' for s in spread))
