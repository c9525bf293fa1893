"""The association rule that settings ask for."""

from saccade.slam.association.identities import GatedIdentity
from saccade.slam.association.nearest_neighbor import NearestNeighbor
from saccade.slam.association.rule import Association, KnownIdentity
from saccade.slam.config import ASSOCIATION_RULES, EkfConfig


def association_rule(config: EkfConfig) -> Association:
    """The rule of `EkfConfig.association`; of "multiple", that in a fixed map."""
    if config.association == "known":
        return KnownIdentity()
    if config.association == "auto":
        geometry = NearestNeighbor(config.gate, config.new_gate, mutual=True)
        return GatedIdentity(config.name_gate, geometry)
    kind = "mutual" if config.association == "multiple" else config.association
    return ASSOCIATION_RULES[kind](config.gate, config.new_gate)
