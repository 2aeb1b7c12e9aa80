"""A painting in the browser, in any light: a static site, or a page for this machine alone.

One script of WebGL 2 lights the maps of a result as :func:`impasto.render` does, within one code of
the display. :func:`write_site` writes a folder that works on any web server and without one;
``impasto view`` serves the same page on the loopback, with tiles that are made when they are asked
for.
"""

from impasto.viewer.contents import Contents
from impasto.viewer.scripts import script
from impasto.viewer.server import ViewServer
from impasto.viewer.site import Site, write_site

__all__ = ["Contents", "Site", "ViewServer", "script", "write_site"]
