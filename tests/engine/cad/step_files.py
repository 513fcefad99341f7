"""STEP files, written by OCCT: shapes with names, places, materials and limits of size."""

import re
from dataclasses import dataclass, field
from math import cos, sin
from pathlib import Path

from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCone, BRepPrimAPI_MakeCylinder
from OCP.collections import Sequence_TDF_Label
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Interface import Interface_Static
from OCP.Message import Message
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_StepModelType
from OCP.TCollection import TCollection_ExtendedString, TCollection_HAsciiString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS
from OCP.XCAFDimTolObjects import (
    XCAFDimTolObjects_DatumObject,
    XCAFDimTolObjects_DimensionObject,
    XCAFDimTolObjects_DimensionType,
    XCAFDimTolObjects_GeomToleranceObject,
)
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_DimensionFormVariance as Form
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_DimensionGrade as Grade
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_GeomToleranceMatReqModif as Material
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_GeomToleranceType as Kind
from OCP.XCAFDimTolObjects import XCAFDimTolObjects_GeomToleranceTypeValue as Shape
from OCP.XCAFDoc import XCAFDoc_Datum, XCAFDoc_Dimension, XCAFDoc_DocumentTool, XCAFDoc_GeomTolerance

Z = (0.0, 0.0, 1.0)


def box(corner, size):
    """Return a box from its lowest corner and its three sides."""
    return BRepPrimAPI_MakeBox(gp_Pnt(*corner), *size).Shape()


def cylinder(base, radius, height, axis=Z):
    """Return a cylinder that stands on a point along an axis."""
    return BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(*base), gp_Dir(*axis)), radius, height).Shape()


def cone(base, radii, height, axis=Z):
    """Return a truncated cone from its radius at the base to that at the top."""
    return BRepPrimAPI_MakeCone(gp_Ax2(gp_Pnt(*base), gp_Dir(*axis)), *radii, height).Shape()


def fused(first, *others):
    """Return the union of shapes."""
    for other in others:
        first = BRepAlgoAPI_Fuse(first, other).Shape()
    return first


def cut(first, *others):
    """Return a shape less others."""
    for other in others:
        first = BRepAlgoAPI_Cut(first, other).Shape()
    return first


def one_face_a_plane(shape):
    """Return a shape in which the faces that a union has cut are one again, as a CAD system exports it."""
    whole = ShapeUpgrade_UnifySameDomain(shape, True, True, False)
    whole.Build()
    return whole.Shape()


def place(x=0.0, y=0.0, z=0.0, angle=0.0):
    """Return a place: turned about z by an angle [rad], then moved."""
    move = gp_Trsf()
    move.SetValues(cos(angle), -sin(angle), 0, x, sin(angle), cos(angle), 0, y, 0, 0, 1, z)
    return move


def mirrored(shape, plane_normal=(1.0, 0.0, 0.0)):
    """Return the mirror image of a shape in a plane through the origin."""
    mirror = gp_Trsf()
    mirror.SetMirror(gp_Ax2(gp_Pnt(), gp_Dir(*plane_normal)))
    return BRepBuilderAPI_Transform(shape, mirror, True).Shape()


def moved(shape, x=0.0, y=0.0, z=0.0):
    """Return a shape at another place."""
    move = gp_Trsf()
    move.SetTranslation(gp_Vec(x, y, z))
    return BRepBuilderAPI_Transform(shape, move, True).Shape()


def faces(shape):
    """Return the faces of a shape."""
    explorer, found = TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_FACE), []
    while explorer.More():
        found.append(TopoDS.Face(explorer.Current()))
        explorer.Next()
    return found


@dataclass
class Drawing:
    """An assembly that becomes a STEP file; lengths in mm, whatever the unit of the file."""

    document: TDocStd_Document = field(default_factory=lambda: TDocStd_Document(TCollection_ExtendedString("XmlXCAF")))

    def __post_init__(self):
        main = self.document.Main()
        self.shapes = XCAFDoc_DocumentTool.ShapeTool_s(main)
        self.materials = XCAFDoc_DocumentTool.MaterialTool_s(main)
        self.dimensions = XCAFDoc_DocumentTool.DimTolTool_s(main)
        XCAFDoc_DocumentTool.SetLengthUnit_s(self.document, 0.001)

    def assembly(self, name):
        """Return a new empty assembly."""
        label = self.shapes.NewShape()
        self._call(label, name)
        return label

    def product(self, name, shape, material=None):
        """Return a new part; the material is its name and its density [g/cm3]."""
        label = self.shapes.AddShape(shape, False)
        self._call(label, name)
        if material is not None:
            texts = [TCollection_HAsciiString(text) for text in (material[0], "", "density measure")]
            kind = TCollection_HAsciiString("POSITIVE_RATIO_MEASURE")
            self.materials.SetMaterial(label, texts[0], texts[1], material[1], texts[2], kind)
        return label

    def add(self, assembly, product, where=None, name=None):
        """Put a part or an assembly into an assembly; return its label there."""
        label = self.shapes.AddComponent(assembly, product, TopLoc_Location(where or gp_Trsf()))
        if name is not None:
            self._call(label, name)
        self.shapes.UpdateAssemblies()
        return label

    @staticmethod
    def plane(point, normal):
        """Return a plane, to mirror in."""
        return gp_Ax2(gp_Pnt(*point), gp_Dir(*normal))

    def diameter(self, product, face, nominal, limits):
        """Attach a diameter to a face of a part, with its lower and upper deviation, or its class such as ``H7``."""
        at = self.shapes.AddSubShape(product, face)
        label = self.dimensions.AddDimension()
        self.dimensions.SetDimension(at, label)
        dimension = XCAFDimTolObjects_DimensionObject()
        dimension.SetType(XCAFDimTolObjects_DimensionType.XCAFDimTolObjects_DimensionType_Size_Diameter)
        dimension.SetValue(nominal)
        if isinstance(limits, str):
            letters = limits.rstrip("0123456789")
            form = getattr(Form, f"XCAFDimTolObjects_DimensionFormVariance_{letters.upper()}")
            grade = getattr(Grade, f"XCAFDimTolObjects_DimensionGrade_IT{limits.removeprefix(letters)}")
            dimension.SetClassOfTolerance(letters.isupper(), form, grade)
        else:
            dimension.SetLowerTolValue(limits[0])
            dimension.SetUpperTolValue(limits[1])
        XCAFDoc_Dimension.Set_s(label).SetObject(dimension)

    def zone(self, product, face, kind, width, *, is_round=True, maximum_material=False, datums=()):
        """Attach a geometric tolerance, such as ``Position``, to a face; `datums` are faces of the same part."""
        label = self.dimensions.AddGeomTolerance()
        self.dimensions.SetGeomTolerance(self.shapes.AddSubShape(product, face), label)
        zone = XCAFDimTolObjects_GeomToleranceObject()
        zone.SetType(getattr(Kind, f"XCAFDimTolObjects_GeomToleranceType_{kind}"))
        zone.SetValue(width)
        if is_round:
            zone.SetTypeOfValue(Shape.XCAFDimTolObjects_GeomToleranceTypeValue_Diameter)
        if maximum_material:
            zone.SetMaterialRequirementModifier(Material.XCAFDimTolObjects_GeomToleranceMatReqModif_M)
        XCAFDoc_GeomTolerance.Set_s(label).SetObject(zone)
        for number, each in enumerate(datums):
            at, on = self.dimensions.AddDatum(), Sequence_TDF_Label()
            on.Append(self.shapes.AddSubShape(product, each))
            datum = XCAFDimTolObjects_DatumObject()
            datum.SetName(TCollection_HAsciiString("ABC"[number]))
            datum.SetPosition(number + 1)
            XCAFDoc_Datum.Set_s(at).SetObject(datum)
            self.dimensions.SetDatum(on, at)
            self.dimensions.SetDatumToGeomTol(at, label)

    def write(self, path, unit="MM", schema="AP242DIS"):
        """Write the file in a unit of length: MM, INCH, M. The same drawing makes the same bytes."""
        Message.DefaultMessenger_s().ChangePrinters().Clear()
        writer = STEPCAFControl_Writer()
        Interface_Static.SetCVal_s("write.step.schema", schema)
        Interface_Static.SetCVal_s("write.step.unit", unit)
        Interface_Static.SetIVal_s("write.surfacecurve.mode", 0)  # curves in parameters can be made anew
        writer.SetNameMode(True)
        writer.SetMaterialMode(True)
        writer.SetDimTolMode(True)
        assert writer.Transfer(self.document, STEPControl_StepModelType.STEPControl_AsIs)
        assert writer.Write(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone
        text = re.sub(r"'\d{4}-\d\d-\d\dT[\d:]+'", "'2026-01-01T00:00:00'", Path(path).read_text("latin-1"))
        Path(path).write_text(_lower_deviations_below_zero(text), "latin-1")
        return path

    def _call(self, label, name):
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(name, True))


def _lower_deviations_below_zero(text):
    """Return a file with the signs of its lower deviations, which OCCT leaves out."""
    lower = set(re.findall(r"= TOLERANCE_VALUE\((#\d+),#\d+\);", text))
    return re.sub(
        r"(#\d+)( = MEASURE_WITH_UNIT\()(?=[1-9])",
        lambda found: "".join((*found.groups(), "-" if found[1] in lower else "")),
        text,
    )


def cylindrical(shape, radius):
    """Return the cylindrical faces of a radius."""
    found = [(face, BRepAdaptor_Surface(face)) for face in faces(shape)]
    kind = GeomAbs_SurfaceType.GeomAbs_Cylinder
    return [
        face
        for face, surface in found
        if surface.GetType() == kind and abs(surface.Cylinder().Radius() - radius) < 1e-9
    ]
