"""Local web page that analyzes a photograph: saliency, scanpath and interest points."""
