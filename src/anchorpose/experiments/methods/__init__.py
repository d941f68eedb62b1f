"""The methods that are compared: a module each kind, with its ``METHODS``. A new one needs a module here, or a file."""
