"""A mirror ball, a lamp and a camera in plain float64 numpy, from the geometry alone.

The place of a highlight is where the path lamp - ball - camera is shortest (Fermat's principle),
found by Newton's method on the sphere: the law of reflection is not used. Frame: x right, y up, z
towards the camera; a perspective camera at the origin looks along -z.
"""

from __future__ import annotations

import numpy as np

STEP = 1e-5


def path_gradient(n, ball, radius, lamp, eye):
    """Derivative of the length of the path by the point on the sphere, along the sphere.

    ``lamp``: a position, or with ``eye`` None a camera far away; a distant lamp is one very far.
    """
    p = ball + radius * n
    to_lamp = (p - lamp) / np.linalg.norm(p - lamp)
    to_eye = np.array([0.0, 0.0, -1.0]) if eye is None else (p - eye) / np.linalg.norm(p - eye)
    g = to_lamp + to_eye
    return g - (g @ n) * n


def highlight(ball, radius, lamp, focal=None):
    """Pixel (x, y) relative to the principal point, y down, of the lamp's mirror image."""
    eye = None if focal is None else np.zeros(3)
    towards_eye = np.array([0.0, 0.0, 1.0]) if eye is None else -ball / np.linalg.norm(ball)
    towards_lamp = (lamp - ball) / np.linalg.norm(lamp - ball)
    n = towards_eye + towards_lamp
    n /= np.linalg.norm(n)
    for _ in range(40):
        a = np.cross(n, [0.0, 1.0, 0.0] if abs(n[1]) < 0.9 else [1.0, 0.0, 0.0])
        a /= np.linalg.norm(a)
        b = np.cross(n, a)

        def at(s, t, n=n, a=a, b=b):
            m = n + s * a + t * b
            m /= np.linalg.norm(m)
            g = path_gradient(m, ball, radius, lamp, eye)
            return np.array([g @ a, g @ b])

        now = at(0.0, 0.0)
        jac = np.stack([(at(STEP, 0) - at(-STEP, 0)), (at(0, STEP) - at(0, -STEP))], axis=1) / (
            2 * STEP
        )
        s, t = -np.linalg.solve(jac, now)
        n = n + s * a + t * b
        n /= np.linalg.norm(n)
        if np.hypot(s, t) < 1e-13:
            break
    p = ball + radius * n
    if focal is None:
        return np.array([p[0], -p[1]])
    return focal * np.array([p[0] / -p[2], p[1] / p[2]])


def outline(ball, radius, focal=None):
    """(x, y, size): circle, or the middle's image and f tan(half angle of the cone)."""
    if focal is None:
        return np.array([ball[0], -ball[1], radius])
    sine = radius / np.linalg.norm(ball)
    x, y = focal * np.array([ball[0] / -ball[2], ball[1] / ball[2]])
    return np.array([x, y, focal * sine / np.sqrt(1.0 - sine * sine)])


def position_bound(balls, radius, lamp, focal, sigma, outline_sigma):
    """(3, 3) Cramer-Rao bound of a lamp's position; unknown: lamp and the middles of the balls."""

    def observed(unknown):
        values = []
        for number in range(len(balls)):
            ball = unknown[3 + 3 * number : 6 + 3 * number]
            values.append(highlight(ball, radius, unknown[:3], focal) / sigma)
            values.append(outline(ball, radius, focal) / outline_sigma)
        return np.concatenate(values)

    truth = np.concatenate([lamp, *balls])
    step = 1e-4 * radius
    slopes = [
        (observed(truth + step * e) - observed(truth - step * e)) / (2 * step)
        for e in np.eye(len(truth))
    ]
    slopes = np.stack(slopes, axis=1)
    return np.linalg.inv(slopes.T @ slopes)[:3, :3]


def photograph(ball, radius, lamps, size, focal=None, glow=1.0, ground=0.3):
    """(y, x): ball before a bright ground, highlights as Gaussians of ``glow`` pixels, 0 to 1."""
    rows, columns = np.indices(size).astype(float)
    middle = np.array([(size[1] - 1) / 2, (size[0] - 1) / 2])
    x, y = columns - middle[0], rows - middle[1]
    if focal is None:
        off = np.hypot(x - ball[0], y + ball[1]) - radius
    else:
        ray = np.stack([x, -y, np.full_like(x, -focal)], axis=-1)
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        across = np.linalg.norm(np.cross(ray, ball), axis=-1)
        off = (across - radius) * focal / np.linalg.norm(ball)
    picture = 0.01 + ground * 0.5 * (1.0 + np.tanh(off / 0.8))
    for lamp in lamps:
        u, v = highlight(ball, radius, lamp, focal)
        picture = picture + 3.0 * np.exp(-0.5 * ((x - u) ** 2 + (y - v) ** 2) / glow**2)
    return picture
