"""The compiled loops of the forward models. The data flow can be followed without reading them."""
