"""Order and policy: which stage follows which."""
