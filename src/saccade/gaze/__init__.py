"""Where a robot looks next, by its map: image -> attention -> landmarks -> map, and back."""

from saccade.gaze.gazer import POLICIES, Gazer, Look, Policy, policy_of

__all__ = ["POLICIES", "Gazer", "Look", "Policy", "policy_of"]
