"""The report: what a campaign showed, as one page that works offline and prints well."""
