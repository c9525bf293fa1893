"""Scores of saliency maps, keypoints, trajectories, maps and landmark selection."""
