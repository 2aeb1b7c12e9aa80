"""Pages in the browser that this machine alone is served."""

from impasto.local_page.server import LARGEST, Page, PageServer, Subject

__all__ = ["LARGEST", "Page", "PageServer", "Subject"]
