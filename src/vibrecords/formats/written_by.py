"""By what files that we write in the formats of other programs are known."""

import re

#: What files in the formats of other programs say of themselves, and how those begin that may be replaced.
WRITTEN_BY = "written by: jointbayes"
OURS = re.compile(rb"(?:#|\$|\*\*|!) written by: jointbayes\r?\n")
