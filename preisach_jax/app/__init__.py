"""The interactive page: `preisach app`. It needs the extra `app`."""
