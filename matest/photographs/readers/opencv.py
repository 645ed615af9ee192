"""What the readers that decode with OpenCV have in common."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from matest.photographs.readers.raster import unreadable


def decode(path: Path, data: bytes, kind: str) -> tuple[np.ndarray, bytes]:
    """Pixels in RGB order, alpha last, and the EXIF block of an image file (empty if it has none).

    Args:
        path: of the file, for the refusal.
        data: its content.
        kind: of file, as people call it.
    """
    import cv2

    # It would print where in its sources a file is damaged.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        image, kinds, blocks = cv2.imdecodeWithMetadata(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        if error.code == cv2.Error.StsNoMem:
            raise MemoryError from None
        image = None
    if image is None:
        raise unreadable(path, f"it is no whole {kind} file that OpenCV decodes")
    if image.ndim == 3 and image.shape[2] == 3:
        image = image[..., ::-1]
    elif image.ndim == 3 and image.shape[2] == 4:
        image = cv2.cvtColor(image, cv2.COLOR_BGRA2RGBA)
    exif = [block for number, block in zip(kinds, blocks, strict=True) if number == cv2.IMAGE_METADATA_EXIF]
    return image, np.asarray(exif[0]).tobytes() if exif else b""
