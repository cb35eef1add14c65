"""Holds pictures of direct light against its closed form, to tell which of two judges is off.

    JUDGE_EVENTS=1 python tests/judges/mitsuba_scene.py SCENE.json Ac 64 160 120 /tmp/direct.npy 4
    python tests/judges/direct.py SCENE.json /tmp/direct.npy [MORE.npy ...]

Lambert's formula for each light, at 3 x 3 points of a pixel of the untextured scene (Ac), wherever a light is neither below the
surface's own horizon nor hidden: further than 6 mm from the press. Prints by how much the mean there departs from it in each
colour, and how the pictures of a file scatter. Not part of any test run.
"""
import json
import sys

import numpy as np

POINTS, FAR_MM = 3, 6
S = json.load(open(sys.argv[1]))
e, c = S['elastomer'], S['camera']


def height(x, y):
    r = np.hypot(x - e['cx'], y - e['cy'])
    ball = e['d'] - e['R'] + np.sqrt(np.maximum(e['R'] ** 2 - r * r, 0))
    return np.where(r <= e['rc'], ball, e['hc'] * np.exp(-e['k'] * (r - e['rc'])))


def exact(w, h):
    """Radiance of each pixel, and which pixels it holds for."""
    t, o = np.tan(np.radians(c['hfov_deg']) / 2), np.array(c['origin'], float)
    at = lambda n: (np.arange(n * POINTS) + 0.5) / (n * POINTS) * 2 - 1
    dx, dy = np.meshgrid(at(w) * t, -at(h) * t * h / w)
    z = np.zeros_like(dx)
    for _ in range(30):
        x, y = o[0] + dx * (o[2] - z), o[1] + dy * (o[2] - z)
        z = height(x, y)
    step = 1e-4
    slope = [(height(x + i, y + j) - height(x - i, y - j)) / (2 * step) for i, j in ((step, 0), (0, step))]
    normal = np.stack([-slope[0], -slope[1], np.ones_like(z)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    place = np.stack([x, y, z], -1)
    known = np.hypot(x - e['cx'], y - e['cy']) > FAR_MM
    radiance = np.zeros(place.shape)
    for light in S['lights']:
        middle, u, v = (np.array(light[k], float) for k in ('center_mm', 'u_dir', 'v_dir'))
        u, v = u * light['size_u_mm'] / 2, v * light['size_v_mm'] / 2
        to = [p - place for p in (middle - u - v, middle + u - v, middle + u + v, middle - u + v)]
        to = [d / np.linalg.norm(d, axis=-1, keepdims=True) for d in to]
        known &= np.min([(d * normal).sum(-1) for d in to], 0) > 0
        form = 0
        for a, b in zip(to, to[1:] + to[:1]):
            across = np.cross(a, b)
            sine = np.linalg.norm(across, axis=-1)
            form = form + np.arctan2(sine, (a * b).sum(-1)) * (across * normal).sum(-1) / sine
        irradiance = np.abs(form) / 2
        radiance += (irradiance * e['albedo_const'] / np.pi)[..., None] * np.array(light['radiance_linear_rgb'])
    parts = (h, POINTS, w, POINTS)
    return radiance.reshape(*parts, 3).mean((1, 3)), known.reshape(parts).all((1, 3))


for path in sys.argv[2:]:
    pictures = np.load(path).astype(np.float64)
    pictures = pictures[None] if pictures.ndim == 3 else pictures
    truth, known = exact(pictures.shape[2], pictures.shape[1])
    off = np.array([100 * (p[known].mean(0) / truth[known].mean(0) - 1) for p in pictures])
    print(path, 'off by', ' '.join(f'{v:+.3f} %' for v in off.mean(0)), ' scatter', ' '.join(f'{v:.3f} %' for v in off.std(0)))
