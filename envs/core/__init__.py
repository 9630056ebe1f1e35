"""The parts that all tasks share: vector environment, task interface, terms, randomisation, drawing."""
