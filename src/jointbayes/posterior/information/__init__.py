"""How well what is known: linearised and from draws."""
