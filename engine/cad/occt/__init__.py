"""The process that reads a CAD file with OCCT: the only code that imports OCP. Nobody imports it, it is started."""
