"""How well `combined` is calibrated, as a picture and a page."""
