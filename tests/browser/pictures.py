"""Compares pictures of a page without a library."""

from __future__ import annotations

from typing import Any

_COUNT = """async ([first, second]) => {
  const load = async (data) => {
    const image = await createImageBitmap(
      await (await fetch("data:image/png;base64," + data)).blob());
    const canvas = new OffscreenCanvas(image.width, image.height);
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, image.width, image.height).data;
  };
  const [a, b] = [await load(first), await load(second)];
  let count = 0;
  for (let i = 0; i < Math.min(a.length, b.length); i += 4)
    if (Math.abs(a[i] - b[i]) + Math.abs(a[i + 1] - b[i + 1]) +
        Math.abs(a[i + 2] - b[i + 2]) > 60) count += 1;
  return count;
}"""
_INK = """(canvas) => {
  if (!canvas.width || !canvas.height) return 0;
  const context = canvas.getContext("2d");
  const data = context.getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    const [r, g, b, a] = [data[i], data[i + 1], data[i + 2], data[i + 3]];
    if (a > 128 && Math.max(r, g, b) - Math.min(r, g, b) > 60) count += 1;
  }
  return count;
}"""


def pixels_changed(page: Any, first: bytes, second: bytes) -> int:
    """Return how many pixels of two PNGs of one size differ clearly."""
    import base64

    texts = [base64.b64encode(picture).decode() for picture in (first, second)]
    count: int = page.evaluate(_COUNT, texts)
    return count


def coloured_pixels(canvas: Any) -> int:
    """Return how many pixels of a 2-D canvas have a colour other than grey."""
    count: int = canvas.evaluate(_INK)
    return count
