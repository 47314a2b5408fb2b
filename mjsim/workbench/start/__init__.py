"""The start page: a campaign from machine template, plan and dropped files, without a text editor."""
