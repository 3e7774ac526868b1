"""Tables of public benchmarks with the rows that others published."""
