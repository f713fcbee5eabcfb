//! Shapes of bodies and what they weigh. The independent truths are tables, geometry by hand and sums over
//! random points.

use holonom::error::{Code, ModelErrors};
use holonom::io::{Document, Syntax, json_schema};
use holonom::model::{Body, Model, ShapeKind};

fn read(text: &str, stl: &[u8]) -> Result<Model, ModelErrors> {
    let mut none = |_: &str| Err("no other file".to_owned());
    let mut asked = Vec::new();
    let mut meshes = |path: &str| {
        asked.push(path.to_owned());
        if path == "models/a/part.stl" { Ok(stl.to_vec()) } else { Err(format!("no `{path}`")) }
    };
    let document = Document::parse(text, Syntax::Toml, "models/a/model.toml", &mut none)?;
    let document = document.with_meshes(&mut meshes)?;
    let model = document.build()?.0;
    // The merged text holds the triangles: what it is read into again needs no file.
    let again = Document::parse(&document.to_json(), Syntax::Json, "again.json", &mut none)?;
    assert_eq!(again.build()?.0.bodies, model.bodies);
    Ok(model)
}

fn spatial(body: &str) -> String {
    format!(
        "holonom = 1\ndimension = \"spatial\"\ngravity = [0.0, 0.0, 0.0]\n\
         [bodies.part]\nposition = [1.0, 2.0, 3.0]\n{body}"
    )
}

fn part(text: &str, stl: &[u8]) -> Body {
    let model = read(text, stl).unwrap_or_else(|errors| panic!("{}", errors.render()));
    model.bodies[0].clone()
}

fn refused(text: &str, stl: &[u8]) -> (Code, String) {
    let errors = read(text, stl).unwrap_err();
    let error = &errors.errors[0];
    let place = error.location.as_ref().map_or(0, |location| location.line);
    (error.code, format!("{place}: {} {}", error.path, errors.render()))
}

#[track_caller]
fn assert_near(found: f64, expected: f64, slack: f64) {
    assert!((found - expected).abs() <= slack, "{found} ≠ {expected}");
}

/// The box from (0, 0, 0) to (1, 2, 3) as STL text, in single precision exact.
fn box_as_stl() -> String {
    let corner = |n: usize| [n & 1, (n >> 1 & 1) * 2, (n >> 2 & 1) * 3];
    let quads =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let vertex = |&n: &usize| {
        let [x, y, z] = corner(n);
        format!("vertex {x} {y} {z}\n")
    };
    let facet = |face: [usize; 3]| {
        let vertices: String = face.iter().map(vertex).collect();
        format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n")
    };
    let facets: String =
        quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).map(facet).collect();
    format!("solid box\n{facets}endsolid box\n")
}

#[test] // independent truth: the dumbbell's moments from tables, and parallel axes by hand
fn a_body_weighs_what_its_shapes_weigh() {
    let body = part(
        &spatial(
            "[bodies.part.shapes]\n\
             left = { type = \"sphere\", radius = 0.1, position = [-0.5, 0.0, 0.2], density = 1000.0 }\n\
             right = { type = \"sphere\", radius = 0.1, position = [0.5, 0.0, 0.2], density = 1000.0 }\n\
             bar = { type = \"cylinder\", radius = 0.02, points_in_body = [[-0.5, 0.0, 0.2], [0.5, 0.0, 0.2]], density = 7850.0 }\n\
             paint = { type = \"box\", size = [9.0, 9.0, 9.0], color = \"#ff8000\", opacity = 0.25 }\n",
        ),
        b"",
    );
    let pi = std::f64::consts::PI;
    let ball = 1000.0 * 4.0 / 3.0 * pi * 0.001;
    let bar = 7850.0 * pi * 0.02 * 0.02;
    assert_near(body.mass, 2.0 * ball + bar, 1e-12);
    for (found, expected) in body.center_of_mass.iter().zip([0.0, 0.0, 0.2]) {
        assert_near(*found, expected, 1e-15);
    }
    let own = 0.4 * ball * 0.01;
    let along = 2.0 * own + 0.5 * bar * 0.02 * 0.02;
    let across = 2.0 * (own + ball * 0.25) + bar * (3.0 * 0.02 * 0.02 + 1.0) / 12.0;
    for (k, expected) in [along, across, across].into_iter().enumerate() {
        assert_near(body.inertia[k][k], expected, 1e-13);
    }
    assert_eq!(body.shapes[3].color, Some([255, 128, 0]));
    assert_eq!(body.shapes[3].opacity, 0.25);
    assert_eq!(body.shapes[2].name, "bar");
}

#[test] // independent truth: the mean over random points, which is off by less than four deviations
fn a_turned_capsule_weighs_what_random_points_say() {
    let body = part(
        &spatial(
            "[bodies.part.shapes]\n\
             pill = { type = \"capsule\", radius = 0.2, length = 0.6, position = [0.1, -0.2, 0.3], density = 500.0, axis_angle = { axis = [1.0, 2.0, -0.5], angle = 0.7 } }\n",
        ),
        b"",
    );
    let axis = {
        // Rodrigues' formula on z
        let (u, angle) = ([1.0, 2.0, -0.5].map(|x: f64| x / 5.25_f64.sqrt()), 0.7_f64);
        let (s, c) = angle.sin_cos();
        [
            u[1] * s + u[0] * u[2] * (1.0 - c),
            -u[0] * s + u[1] * u[2] * (1.0 - c),
            c + u[2] * u[2] * (1.0 - c),
        ]
    };
    let mut seed = 7_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let (half, count) = (0.55, 400_000);
    let (mut inside, mut moments) = (0.0, [[0.0; 3]; 3]);
    for _ in 0..count {
        let x = [0; 3].map(|_| 2.0 * half * random());
        let along = (0..3).map(|k| axis[k] * x[k]).sum::<f64>();
        let beyond = (along.abs() - 0.3).max(0.0);
        let across = (x.iter().map(|c| c * c).sum::<f64>() - along * along).max(0.0);
        if across + beyond * beyond <= 0.04 {
            inside += 1.0;
            for i in 0..3 {
                for j in 0..3 {
                    let square = if i == j { x.iter().map(|c| c * c).sum() } else { 0.0 };
                    moments[i][j] += square - x[i] * x[j];
                }
            }
        }
    }
    let cell = 500.0 * (2.0_f64 * half).powi(3) / f64::from(count);
    let share = inside / f64::from(count);
    let deviation = (share * (1.0 - share) / f64::from(count)).sqrt() / share;
    assert_near(body.mass, cell * inside, 4.0 * deviation * body.mass);
    for i in 0..3 {
        assert_near(body.center_of_mass[i], [0.1, -0.2, 0.3][i], 1e-15);
        for j in 0..3 {
            // No square is larger than 0.25 m².
            assert_near(
                body.inertia[i][j],
                cell * moments[i][j],
                4.0 * deviation * body.mass * 0.25,
            );
        }
    }
}

#[test] // independent truth: the formula of the box
fn a_mesh_is_read_and_weighed() {
    let stl = box_as_stl();
    let body = part(
        &spatial(
            "[bodies.part.shapes.whole]\ntype = \"mesh\"\nfile = \"part.stl\"\nscale = 0.1\n\
             position = [-0.05, -0.1, -0.15]\ndensity = 1000.0\n",
        ),
        stl.as_bytes(),
    );
    assert_near(body.mass, 6.0, 1e-12);
    for (k, sum) in [0.04 + 0.09, 0.01 + 0.09, 0.01 + 0.04].into_iter().enumerate() {
        assert_near(body.inertia[k][k], 6.0 / 12.0 * sum, 1e-13);
        assert_near(body.center_of_mass[k], 0.0, 1e-15);
    }
    let ShapeKind::Mesh(surface) = &body.shapes[0].kind else { panic!() };
    assert_eq!((surface.vertices.len(), surface.faces.len()), (8, 12));
}

#[test] // independent truth: the same part in metres
fn units_of_a_file_are_those_of_its_shapes_and_meshes() {
    let stl = box_as_stl();
    let text = spatial(
        "[bodies.part.shapes]\nwhole = { type = \"mesh\", file = \"part.stl\", density = 7.85e-9 }\n\
         pin = { type = \"cylinder\", radius = 10.0, length = 40.0, density = 7.85e-9, color = \"#000000\" }\n",
    );
    let text = text.replace("gravity", "units = { length = \"mm\", mass = \"t\" }\ngravity");
    let body = part(&text, stl.as_bytes());
    let pin = 7850.0 * std::f64::consts::PI * 1e-4 * 0.04;
    assert_near(body.mass, 7850.0 * 6e-9 + pin, 1e-12);
    let ShapeKind::Mesh(surface) = &body.shapes[0].kind else { panic!() };
    assert_eq!(surface.vertices.iter().map(|v| v[2]).fold(0.0, f64::max), 0.003);
}

#[test] // independent truth: the moment of a disc about its middle and about a point beside it
fn planar_bodies_have_shapes_in_their_plane() {
    let text = "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n\
        [bodies.part]\nposition = [0.0, 0.0]\n\
        [bodies.part.shapes]\n\
        disc = { type = \"cylinder\", radius = 0.2, length = 0.05, position = [0.3, 0.0], level = 0.4, density = 1000.0 }\n\
        arm = { type = \"capsule\", radius = 0.01, points_in_body = [[0.0, 0.0], [0.0, 0.5]], level = -0.02 }\n";
    let body = part(text, b"");
    let mass = 1000.0 * std::f64::consts::PI * 0.04 * 0.05;
    assert_near(body.mass, mass, 1e-12);
    assert_near(body.inertia[2][2], 0.5 * mass * 0.04, 1e-13);
    assert_eq!(body.center_of_mass, [0.3, 0.0, 0.0]);
    let arm = &body.shapes[1];
    assert_eq!(arm.position, [0.0, 0.25, -0.02]);
    assert_eq!(arm.axes.map(|row| row[2]), [0.0, 1.0, 0.0]);
}

#[test]
fn patterns_and_extending_files_have_shapes() {
    let base = spatial(
        "mass = 1.0\ninertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n\
         shapes.a = { type = \"sphere\", radius = 0.1 }\nshapes.b = { type = \"sphere\", radius = 0.2 }\n",
    );
    let text = "holonom = 1\nextends = \"../b/model.toml\"\n\
        bodies.part.shapes.b.enabled = false\nbodies.part.shapes.a.radius = 0.3\n\
        [patterns.row]\nover.i = { from = 1, to = 3 }\n\
        [patterns.row.bodies.\"ball_{i}\"]\nposition = [\"=i\", 0.0, 0.0]\n\
        shapes.own = { type = \"sphere\", radius = \"=i/10\", density = 1.0 }\n\
        shapes.skin = { type = \"mesh\", file = \"part.stl\" }\n";
    let mut resolver = |_: &str| Ok(base.clone());
    let mut meshes = |_: &str| Ok(box_as_stl().into_bytes());
    let document =
        Document::parse(text, Syntax::Toml, "models/a/model.toml", &mut resolver).unwrap();
    let document = document.with_meshes(&mut meshes).unwrap();
    let document =
        document.with_values(&[("bodies.ball_3.shapes.own.radius", 1.0.into())]).unwrap();
    let model = document.build().unwrap_or_else(|e| panic!("{}", e.render())).0;
    let part = &model.bodies[0];
    assert_eq!(part.shapes.len(), 1);
    assert_eq!(part.shapes[0].kind, ShapeKind::Sphere { radius: 0.3 });
    for (body, radius) in model.bodies[1..].iter().zip([0.1_f64, 0.2, 1.0]) {
        assert_near(body.mass, 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3), 1e-12);
        assert_eq!(body.shapes.len(), 2);
    }
}

#[test]
fn what_is_wrong_with_a_shape_is_told_with_its_place() {
    let weight = "mass = 1.0\ninertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n";
    let shape =
        |fields: &str| spatial(&format!("{weight}[bodies.part.shapes]\none = {{ {fields} }}\n"));
    let open = box_as_stl().replacen("vertex 1 2 3", "vertex 1 2 2.5", 1);
    let dense =
        "[bodies.part.shapes]\none = { type = \"mesh\", file = \"part.stl\", density = 1.0 }\n";
    let cases: Vec<(String, &[u8], Code, &str)> = vec![
        (shape("type = \"sphere\", radius = -1.0"), b"", Code::OutOfRange, "shapes.one.radius"),
        (shape("type = \"spere\", radius = 1.0"), b"", Code::UnknownChoice, "\"sphere\"?"),
        (shape("type = \"sphere\", radus = 1.0"), b"", Code::UnknownField, "`radius`?"),
        (shape("type = \"box\", size = [1.0, 1.0]"), b"", Code::WrongSize, "3 numbers (m)"),
        (
            shape("type = \"sphere\", radius = 1.0, color = \"red\""),
            b"",
            Code::OutOfRange,
            "#rrggbb",
        ),
        (shape("type = \"sphere\", radius = 1.0, opacity = 2.0"), b"", Code::OutOfRange, "0 to 1"),
        (
            shape("type = \"sphere\", radius = 1.0, level = 1.0"),
            b"",
            Code::WrongDimension,
            "planar",
        ),
        (shape("type = \"cylinder\", radius = 1.0"), b"", Code::MissingField, "points_in_body"),
        (
            shape(
                "type = \"capsule\", radius = 1.0, length = 1.0, points_in_body = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]",
            ),
            b"",
            Code::ConflictingFields,
            "leave one",
        ),
        (
            shape(
                "type = \"capsule\", radius = 1.0, points_in_body = [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]",
            ),
            b"",
            Code::CoincidentPoints,
            "coincide",
        ),
        (shape("type = \"mesh\""), b"", Code::MissingField, "file"),
        (shape("type = \"mesh\", file = \"other.stl\""), b"", Code::Mesh, "models/a/other.stl"),
        (shape("type = \"mesh\", file = \"/part.stl\""), b"", Code::Mesh, "relative"),
        (shape("type = \"mesh\", file = \"part.stl\""), b"solid", Code::Mesh, "no triangles"),
        (
            shape("type = \"mesh\", vertices = [[0.0, 0.0, 0.0]], faces = [[0, 0, 1]]"),
            b"",
            Code::Mesh,
            "faces[0]",
        ),
        (
            shape("type = \"sphere\", radius = 1.0, density = 1.0"),
            b"",
            Code::ConflictingFields,
            "mass",
        ),
        (spatial(dense), open.as_bytes(), Code::Mesh, "is not closed"),
        (
            spatial("shapes.one = { type = \"sphere\", radius = 1.0 }\n"),
            b"",
            Code::MissingField,
            "density",
        ),
        (
            spatial("shapes.one = { type = \"sphere\", radius = 1.0, density = 0.0 }\n"),
            b"",
            Code::OutOfRange,
            "kg/m³",
        ),
        (spatial(""), b"", Code::MissingField, "`mass`; expected a number (kg)"),
    ];
    for (text, stl, code, part) in cases {
        let (found, told) = refused(&text, stl);
        assert_eq!(found, code, "{told}");
        assert!(told.contains(part), "{part} is not in: {told}");
        assert!(!told.starts_with("0:"), "no line: {told}");
    }
}

#[test]
fn the_schema_asks_for_a_mass_or_for_shapes() {
    let schema: serde_json::Value = serde_json::from_str(&json_schema()).unwrap();
    let body = &schema["$defs"]["Body"];
    assert_eq!(
        body["anyOf"],
        serde_json::json!([{ "required": ["mass", "inertia"] }, { "required": ["shapes"] }])
    );
    assert_eq!(body["required"], serde_json::json!(["position"]));
}
