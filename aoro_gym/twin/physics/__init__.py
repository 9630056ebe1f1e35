"""The physical laws of the twin: one ``wp.func`` a law, one file a domain, SI units throughout."""
