//! Triangles from the bytes of an STL file, binary or text.

use indexmap::IndexSet;

use crate::watch::{NAMED, checkpoint};

/// Bytes before the count of a binary file, and of one triangle: normal, corners, attribute.
const HEADER: usize = 80;
const TRIANGLE: usize = 50;

/// Points, each once, and triangles by their indices.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Triangles {
    pub(super) vertices: Vec<[f64; 3]>,
    pub(super) faces: Vec<[usize; 3]>,
}

/// Reads an STL file of at most `most` triangles. Corners that are equal to the last digit become one point;
/// triangles that have two corners in one point are left out.
///
/// # Errors
/// The reason why it cannot be read.
pub(super) fn triangles(bytes: &[u8], most: usize) -> Result<Triangles, String> {
    // Texts begin with `solid`, but so do headers of binary files: the size decides.
    let count =
        bytes.get(HEADER..HEADER + 4).and_then(|b| Some(u32::from_le_bytes(b.try_into().ok()?)));
    let body = bytes.get(HEADER + 4..).unwrap_or_default();
    let is_binary = count.is_some_and(|n| n as usize * TRIANGLE == body.len());
    let begins = |word: &str| {
        let start = bytes.trim_ascii_start().get(..word.len());
        start.is_some_and(|start| start.eq_ignore_ascii_case(word.as_bytes()))
    };
    let corners = if is_binary {
        of_binary(body, most)?
    } else if begins("solid") && !bytes.contains(&0) {
        // Names of solids may be in any encoding; zeros are in binary files alone.
        of_text(&String::from_utf8_lossy(bytes), most)?
    } else {
        return Err(match count {
            Some(n) => format!(
                "it is no STL file: a text begins with `solid` and has no zeros, a binary one of {n} triangles has {} bytes, this one {}",
                HEADER + 4 + n as usize * TRIANGLE,
                bytes.len()
            ),
            None => {
                "it is no STL file: it begins neither with `solid` nor with 84 bytes".to_owned()
            }
        });
    };
    let mut known: IndexSet<[u32; 3]> = IndexSet::new();
    let mut faces = Vec::with_capacity(corners.len() / 3);
    for triangle in corners.chunks_exact(3) {
        checkpoint(NAMED);
        let mut face = [0; 3];
        for (index, corner) in face.iter_mut().zip(triangle) {
            if !corner.iter().all(|x| x.is_finite()) {
                return Err("it has a coordinate that is not finite".to_owned());
            }
            // Zero has two signs, which are one place.
            *index = known.insert_full(corner.map(|x| (x + 0.0).to_bits())).0;
        }
        if face[0] != face[1] && face[1] != face[2] && face[2] != face[0] {
            faces.push(face);
        }
    }
    if faces.is_empty() {
        return Err("it has no triangles".to_owned());
    }
    let vertices = known.iter().map(|bits| bits.map(|b| decimal(f32::from_bits(b)))).collect();
    Ok(Triangles { vertices, faces })
}

/// The shortest decimal number that the file's single precision stands for.
fn decimal(x: f32) -> f64 {
    x.to_string().parse().unwrap_or(f64::from(x))
}

fn of_binary(body: &[u8], most: usize) -> Result<Vec<[f32; 3]>, String> {
    limited(body.len() / TRIANGLE, most)?;
    let number = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|k| body[at + k]));
    let corners = (0..body.len() / TRIANGLE).flat_map(|n| (1..4).map(move |c| (n, c)));
    Ok(corners.map(|(n, c)| [0, 1, 2].map(|k| number(TRIANGLE * n + 12 * c + 4 * k))).collect())
}

fn of_text(text: &str, most: usize) -> Result<Vec<[f32; 3]>, String> {
    let mut corners = Vec::new();
    // What follows `solid` and `endsolid` in their lines, up to the first facet, is a name.
    let mut words = text.split(['\n', '\r']).flat_map(|line| {
        let mut in_name = false;
        line.split_whitespace().filter(move |word| {
            let is = |known: &str| word.eq_ignore_ascii_case(known);
            in_name = is("solid") || is("endsolid") || (in_name && !is("facet"));
            !in_name
        })
    });
    while let Some(word) = words.next() {
        if !word.eq_ignore_ascii_case("vertex") {
            continue;
        }
        let mut corner = [0.0; 3];
        for x in &mut corner {
            let number = words.next().unwrap_or_default();
            *x = number.parse().map_err(|_| {
                let shown: String = number.chars().take(40).collect();
                format!(
                    "`{shown}` stands in the place of a coordinate, at its corner {}",
                    corners.len()
                )
            })?;
        }
        corners.push(corner);
        limited(corners.len() / 3, most)?;
    }
    if corners.len() % 3 == 0 {
        Ok(corners)
    } else {
        Err(format!("it has {} corners, which are no whole triangles", corners.len()))
    }
}

fn limited(count: usize, most: usize) -> Result<(), String> {
    if count <= most {
        return Ok(());
    }
    Err(format!("it has more than {most} triangles: make it coarser"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [[f32; 3]; 4] =
        [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [-0.0, 0.0, 0.3]];
    const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    fn binary(faces: &[[usize; 3]], header: &str) -> Vec<u8> {
        let mut out = format!("{header:<80}").into_bytes();
        out.extend((faces.len() as u32).to_le_bytes());
        for face in faces {
            out.extend([0; 12]);
            for &corner in face {
                out.extend(CORNERS[corner].iter().flat_map(|x| x.to_le_bytes()));
            }
            out.extend([0; 2]);
        }
        out
    }

    fn text(faces: &[[usize; 3]]) -> String {
        let vertex = |&corner: &usize| {
            let [x, y, z] = CORNERS[corner];
            format!("      vertex {x:e} {y} {z:E}\n")
        };
        let facet = |face: &[usize; 3]| {
            let vertices: String = face.iter().map(vertex).collect();
            format!("  facet normal 0 0 0\n    outer loop\n{vertices}    endloop\n  endfacet\n")
        };
        let facets: String = faces.iter().map(facet).collect();
        format!("solid a tetrahedron\n{facets}endsolid\n")
    }

    #[test] // independent truth: the corners that both files were written from
    fn both_kinds_of_files_give_the_same_triangles() {
        let named = |name: &str| text(&FACES).replace("a tetrahedron", name);
        let latin = "Geh\u{e4}use".chars().map(|c| c as u8).collect::<Vec<u8>>();
        let [before, after] = ["solid ", &named("")[6..]].map(|part| part.as_bytes().to_vec());
        for bytes in [
            binary(&FACES, "by hand"),
            binary(&FACES, "solid"),
            text(&FACES).into_bytes(),
            text(&FACES).to_uppercase().replace('\n', "\r\n").into_bytes(),
            named("vertex plate, mm").into_bytes(),
            text(&FACES).replace('\n', "\r").into_bytes(),
            text(&FACES).replace('\n', " ").into_bytes(),
            [before, latin, after].concat(),
        ] {
            let found = triangles(&bytes, 4).unwrap();
            assert_eq!(found.vertices.len(), 4);
            for (face, corners) in found.faces.iter().zip(FACES) {
                for (&index, corner) in face.iter().zip(corners) {
                    let written = CORNERS[corner].map(|x| format!("{x}").parse::<f64>().unwrap());
                    assert_eq!(found.vertices[index], written);
                }
            }
        }
    }

    #[test]
    fn what_is_no_stl_is_refused_with_the_reason() {
        let (whole, named) = (binary(&FACES, ""), binary(&FACES, "solid"));
        let mut infinite = whole.clone();
        infinite[HEADER + 4 + 12..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        for (bytes, reason) in [
            (&b""[..], "no STL file"),
            (&whole[..whole.len() - 1], "284 bytes, this one 283"),
            (&named[..named.len() - 1], "284 bytes, this one 283"),
            (&infinite[..], "not finite"),
            (&b"solid\nendsolid"[..], "no triangles"),
            (&b"solid\nvertex 0 0 0"[..], "no whole triangles"),
            (&b"solid\nvertex 0 x 0"[..], "`x` stands"),
            (&whole[..], "more than 3 triangles"),
            (&binary(&[[0, 0, 1]], "")[..], "no triangles"),
        ] {
            let most = if reason.contains("more") { 3 } else { 4 };
            let error = triangles(bytes, most).unwrap_err();
            assert!(error.contains(reason), "{error}");
        }
    }
}
