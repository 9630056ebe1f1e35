"""How fast twins and environments step here, beside peers: what ``aoro-gym bench`` runs."""
