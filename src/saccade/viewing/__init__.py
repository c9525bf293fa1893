"""Pictures and pages, made from the nouns of `saccade.types`."""
