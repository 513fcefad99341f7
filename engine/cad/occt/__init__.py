"""The process that reads CAD files with OCCT. Only this code imports OCP; it is started, never imported."""
