import numpy as np

from saccade.attention.combined import AttentionConfig
from saccade.attention.models import AttentionModel
from saccade.cli.look_video import VideoRecord


def test_the_gaze_has_one_center_whatever_the_prior_of_the_map(tmp_path, rng):
    frames = (rng.random((20, 64, 96, 3)) * 255).astype(np.uint8)
    gazes = []
    for number, config in enumerate((AttentionConfig(), AttentionConfig.free_viewing())):
        record = VideoRecord(AttentionModel("attention", config))
        for time, frame in enumerate(frames):
            record.add(time / 5, frame)
        record.write("film", tmp_path / str(number))
        gazes.append(np.load(tmp_path / f"{number}.npz")["gaze"])
    assert len(np.unique(gazes[0], axis=0)) > 3
    np.testing.assert_array_equal(*gazes)
