"""Other ways to answer the same questions, marked beside the diagnosis."""
