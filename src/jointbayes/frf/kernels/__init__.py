"""The compiled loops of the forward models: nobody needs to read them to follow the data."""
