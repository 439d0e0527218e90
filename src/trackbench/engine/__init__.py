"""How the equations of filters, models and scores are computed: by NumPy, or by machine code traced from the same."""
