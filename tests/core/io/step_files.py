"""Small STEP files (ISO 10303-21, AP214), written entity by entity."""

HEADER = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','2026-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));
ENDSEC;
DATA;
"""
END = "ENDSEC;\nEND-ISO-10303-21;\n"
UNITS = {
    "millimetre": "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))",
    "metre": "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))",
}
# Corners of a box, counted by bits x + 2 y + 4 z, around each side as seen from outside.
SIDES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


class Step:
    """Entities, numbered as they are added."""

    def __init__(self):
        self.lines = []

    def add(self, text):
        self.lines.append(f"#{len(self.lines) + 1}={text};\n")
        return f"#{len(self.lines)}"

    def listed(self, kind, members, before="''"):
        return self.add(f"{kind}({before},({','.join(members)}))")

    def point(self, place):
        return self.add(f"CARTESIAN_POINT('',({','.join(repr(float(x)) for x in place)}))")

    def direction(self, way):
        return self.add(f"DIRECTION('',({','.join(repr(float(x)) for x in way)}))")

    def placement(self, place=(0, 0, 0), axis=(0, 0, 1), across=(1, 0, 0)):
        return self.add(
            f"AXIS2_PLACEMENT_3D('',{self.point(place)},{self.direction(axis)},{self.direction(across)})"
        )

    def box(self, size):
        """A solid with one corner at the origin."""
        corners = [tuple(((n >> k) & 1) * size[k] for k in range(3)) for n in range(8)]
        vertices = [self.add(f"VERTEX_POINT('',{self.point(corner)})") for corner in corners]
        edges = {}
        faces = []
        for side in SIDES:
            loop = []
            for a, b in zip(side, side[1:] + side[:1], strict=True):
                if (b, a) in edges:
                    loop.append(self.add(f"ORIENTED_EDGE('',*,*,{edges[b, a]},.F.)"))
                    continue
                way = [corners[b][k] - corners[a][k] for k in range(3)]
                vector = self.add(f"VECTOR('',{self.direction(way)},1.)")
                line = self.add(f"LINE('',{self.point(corners[a])},{vector})")
                edges[a, b] = self.add(f"EDGE_CURVE('',{vertices[a]},{vertices[b]},{line},.T.)")
                loop.append(self.add(f"ORIENTED_EDGE('',*,*,{edges[a, b]},.T.)"))
            first, second, last = (corners[side[k]] for k in (0, 1, 3))
            u, v = ([p[k] - first[k] for k in range(3)] for p in (second, last))
            normal = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
            plane = self.add(f"PLANE('',{self.placement(first, normal, u)})")
            bound = self.add(f"FACE_OUTER_BOUND('',{self.listed('EDGE_LOOP', loop)},.T.)")
            faces.append(self.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
        return self.add(f"MANIFOLD_SOLID_BREP('',{self.listed('CLOSED_SHELL', faces)})")

    def sphere(self, radius, centre=(0, 0, 0)):
        pole = self.add(f"VERTEX_POINT('',{self.point((centre[0], centre[1], centre[2] - radius))})")
        bound = self.add(f"FACE_BOUND('',{self.add(f'VERTEX_LOOP({chr(39) * 2},{pole})')},.T.)")
        surface = self.add(f"SPHERICAL_SURFACE('',{self.placement(centre)},{float(radius)!r})")
        face = self.add(f"ADVANCED_FACE('',({bound}),{surface},.T.)")
        return self.add(f"MANIFOLD_SOLID_BREP('',{self.listed('CLOSED_SHELL', [face])})")

    def context(self, unit):
        length = self.add(UNITS[unit])
        angle = self.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
        solid = self.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
        error = self.add(
            f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),{length},'distance_accuracy_value','')"
        )
        return self.add(
            "(GEOMETRIC_REPRESENTATION_CONTEXT(3)"
            f"GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({error}))"
            f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid}))"
            "REPRESENTATION_CONTEXT('',''))"
        )

    def product(self, name, solids, context, more=()):
        """A product with a shape; its definition and its representation."""
        application = self.add("APPLICATION_CONTEXT('automotive design')")
        self.add(f"APPLICATION_PROTOCOL_DEFINITION('','automotive_design',2000,{application})")
        about = self.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
        product = self.add(f"PRODUCT('{name}','{name}','',({about}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        design = self.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
        definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},{design})")
        shape = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        items = [self.placement(), *solids, *more]
        kind = "ADVANCED_BREP_SHAPE_REPRESENTATION" if solids else "SHAPE_REPRESENTATION"
        representation = self.add(f"{kind}('',({','.join(items)}),{context})")
        self.add(f"SHAPE_DEFINITION_REPRESENTATION({shape},{representation})")
        return definition, representation, items[0]

    def place(self, whole, part, at, number):
        """Put a part into an assembly, both as `product` returned them."""
        use = self.add(f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{number}','','',{whole[0]},{part[0]},$)")
        shape = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{use})")
        move = self.add(f"ITEM_DEFINED_TRANSFORMATION('','',{part[2]},{at})")
        relation = self.add(
            f"(REPRESENTATION_RELATIONSHIP('','',{part[1]},{whole[1]})"
            f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION({move})SHAPE_REPRESENTATION_RELATIONSHIP())"
        )
        self.add(f"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION({relation},{shape})")

    def assembly(self, name, context, parts, places, first=0, use=""):
        """A product of parts at as many places, whose instances are numbered from `first`."""
        whole = self.product(name, [], context, more=places)
        for number, (part, at) in enumerate(zip(parts, places, strict=True), first):
            self.place(whole, part, at, f"{use}{number}")
        return whole

    def data(self):
        return (HEADER + "".join(self.lines) + END).encode()


def step_box(size=(1, 2, 3), unit="millimetre"):
    file = Step()
    solid = file.box(size)
    file.product("box", [solid], file.context(unit))
    return file.data()


def step_sphere(radius=1.0, centre=(0, 0, 0), unit="millimetre"):
    file = Step()
    solid = file.sphere(radius, centre)
    file.product("sphere", [solid], file.context(unit))
    return file.data()


def step_assembly(
    size=(1, 2, 3), places=(((0, 0, 0), (0, 0, 1), (1, 0, 0)), ((10, 0, 0), (0, 0, 1), (0, 1, 0)))
):
    """A box shown at several places: origin, z axis and x axis of each."""
    file = Step()
    context = file.context("millimetre")
    part = file.product("box", [file.box(size)], context)
    file.assembly("whole", context, [part] * len(places), [file.placement(*place) for place in places])
    return file.data()


def step_machine():
    """A machine: two bearings, each of a ring and two pins, a pin of its own, and two plates.

    The pins of the machine and of the bearings are two products of one name and one form; the plates are two
    products of one name and two sizes.
    """
    file = Step()
    context = file.context("millimetre")
    pin, again = (file.product("pin", [file.box((1, 2, 3))], context) for _ in range(2))
    ring = file.product("ring", [file.sphere(2)], context)
    plate, larger = (file.product("plate", [file.box((size, size, 1))], context) for size in (8, 9))
    at = [file.placement((10 * n, 0, 0), (0, 0, 1), (0, 1, 0)) for n in range(8)]
    bearing = file.assembly("bearing", context, [ring, pin, pin], at[:3], use="use ")
    file.assembly("machine", context, [bearing, bearing, again, plate, larger], at[3:], 3, "use ")
    return file.data()


def step_circle():
    """An assembly that contains itself, inside another."""
    file = Step()
    context = file.context("millimetre")
    part = file.product("box", [file.box((1, 2, 3))], context)
    at = [file.placement((10 * n, 0, 0)) for n in range(3)]
    inner = file.product("inner", [], context, more=at[:2])
    outer = file.product("outer", [], context, more=at[2:])
    for number, (whole, held) in enumerate([(inner, inner), (inner, part), (outer, inner)]):
        file.place(whole, held, at[number], number)
    return file.data()


def step_doubled(levels):
    """Assemblies inside each other, each of two of the next: 2 ** levels boxes."""
    file = Step()
    context = file.context("millimetre")
    inner = file.product("box", [file.box((1, 2, 3))], context)
    for level in range(levels):
        at = [file.placement((10 * n * (level + 1), 0, 0)) for n in range(2)]
        inner = file.assembly(f"level {level}", context, [inner] * 2, at)
    return file.data()
