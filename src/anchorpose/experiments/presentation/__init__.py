"""What readers see of an outcome: tables, claims, figures and the page. Nothing here changes a result."""
