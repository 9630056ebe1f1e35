"""Judge of a diagnosis: which cases show anything, and what they could be, from exact plants and without the diagnosis."""
