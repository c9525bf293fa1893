"""The images of the reference saliency maps."""

REFERENCE_IMAGES = (
    "photo_astronaut",
    "photo_chelsea",
    "photo_coffee",
    "photo_motorcycle",
    "photo_rocket",
    "popout_color",
    "popout_color_gray",
    "popout_conjunction",
    "popout_intensity",
    "popout_orientation",
    "synthetic_single_square",
    "synthetic_symmetric_shapes",
)
"""What the reference implementations of saliency were run on."""
