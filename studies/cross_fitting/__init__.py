"""Networks that families of plants teach beside simulated twins, each network without some of the families."""
