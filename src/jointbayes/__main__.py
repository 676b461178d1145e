"""``python -m jointbayes``: the command line."""

from jointbayes.cli.commands import main

main(prog_name="jointbayes")
