//! Positions and polygons of a Wavefront OBJ file.
//!
//! Texture coordinates, normals, groups and materials are not read; an index into them may be
//! wrong. A line may go on after a backslash, and faces may come before their vertices.

use std::str;

use crate::error::{Error, Result};

/// Polygons over points, as the file lists them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Polygons {
    /// Positions of the vertices, in the order of the file; not a number where that of a vertex
    /// without a polygon cannot be read.
    pub positions: Vec<[f64; 3]>,
    /// Vertices of all polygons, one polygon after the other.
    pub corners: Vec<i64>,
    /// Where each polygon ends in `corners`; a polygon has three corners or more.
    pub ends: Vec<i64>,
}

/// Reads the bytes of a file in ASCII or an encoding that contains it.
///
/// # Errors
///
/// [`Error::Syntax`] for the position of a vertex in a polygon and for an index that is not a
/// number, and for an index of a vertex that does not exist; it names the line.
pub fn parse(text: &[u8]) -> Result<Polygons> {
    let mut polygons = Polygons::default();
    let mut open = Open {
        farthest: (0, -1),
        unread: Vec::new(),
    };
    let mut tokens: Vec<&[u8]> = Vec::new();
    let mut number = 0;
    for line in text.split(|&byte| byte == b'\n') {
        number += 1;
        let line = line.trim_ascii();
        let (line, continued) = match line.strip_suffix(b"\\") {
            Some(start) => (start, true),
            None => (line, false),
        };
        // Old Macintosh files end their lines with a carriage return alone.
        for (end, part) in ends(line) {
            let words = part
                .split(u8::is_ascii_whitespace)
                .filter(|w| !w.is_empty());
            tokens.extend(words.take_while(|word| word[0] != b'#'));
            if !(end && continued) {
                element(&mut polygons, &tokens, number, &mut open)?;
                tokens.clear();
            }
        }
    }
    element(&mut polygons, &tokens, number, &mut open)?;
    let (line, index) = open.farthest;
    let count = polygons.positions.len();
    if index >= count as i64 {
        return Err(missing(line, index + 1, count));
    }
    if !open.unread.is_empty() {
        let mut used = vec![false; count];
        for &corner in &polygons.corners {
            used[corner as usize] = true;
        }
        for (vertex, error) in open.unread {
            if used[vertex] {
                return Err(error);
            }
        }
    }
    Ok(polygons)
}

/// What only the rest of the file can decide.
struct Open {
    /// Line of the largest index so far, which a later vertex may still make legal.
    farthest: (usize, i64),
    /// Vertices without a position, and what is wrong with them. Those that no face uses are fine.
    unread: Vec<(usize, Error)>,
}

/// Parts between carriage returns, and whether each is the last.
fn ends(line: &[u8]) -> impl Iterator<Item = (bool, &[u8])> {
    let mut parts = line.split(|&byte| byte == b'\r').peekable();
    std::iter::from_fn(move || {
        let part = parts.next()?;
        Some((parts.peek().is_none(), part))
    })
}

fn element(polygons: &mut Polygons, tokens: &[&[u8]], line: usize, open: &mut Open) -> Result<()> {
    match tokens {
        [b"v", rest @ ..] => {
            let mut position = [0.0; 3];
            for (axis, value) in position.iter_mut().enumerate() {
                let token = rest.get(axis).copied().unwrap_or_default();
                if let Some(read) = number(token) {
                    *value = read;
                    continue;
                }
                let reason = format!(
                    "coordinate {axis} of a vertex, {}, is no number",
                    shown(token)
                );
                let error = Error::Syntax { line, reason };
                open.unread.push((polygons.positions.len(), error));
                position = [f64::NAN; 3];
                break;
            }
            polygons.positions.push(position);
        }
        // Two corners enclose nothing.
        [b"f" | b"fo", rest @ ..] if rest.len() > 2 => {
            for token in rest {
                let index = vertex(token, polygons.positions.len(), line)?;
                polygons.corners.push(index);
                if index > open.farthest.1 {
                    open.farthest = (line, index);
                }
            }
            polygons.ends.push(polygons.corners.len() as i64);
        }
        _ => {}
    }
    Ok(())
}

/// Index from 0 of the vertex that a corner names, counted from 1 or back from the end.
fn vertex(token: &[u8], count: usize, line: usize) -> Result<i64> {
    let name = token.split(|&byte| byte == b'/').next().unwrap_or_default();
    match number::<i64>(name) {
        Some(index @ 1..) => Ok(index - 1),
        Some(index) if index < 0 && index.unsigned_abs() <= count as u64 => {
            Ok(count as i64 + index)
        }
        Some(index) => Err(missing(line, index, count)),
        None => Err(Error::Syntax {
            line,
            reason: format!("corner {} of a face names no vertex", shown(token)),
        }),
    }
}

fn number<T: str::FromStr>(token: &[u8]) -> Option<T> {
    str::from_utf8(token).ok()?.parse().ok()
}

fn missing(line: usize, index: i64, count: usize) -> Error {
    Error::Syntax {
        line,
        reason: format!("there is no vertex {index} among {count}"),
    }
}

/// A token as text, cut short and on one line.
fn shown(token: &[u8]) -> String {
    let text = String::from_utf8_lossy(&token[..token.len().min(20)]);
    format!("{text:?}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(text: &[u8]) -> String {
        parse(text).expect_err("refused").to_string()
    }

    #[test]
    fn positions_and_corners_of_every_kind() {
        let text = b"# v 9 9 9\n\
            mtllib a.mtl\nv 0 0 0 1.0\nv 1.5 0 -2e-1 0.1 0.2 0.3\r\n  v\t0 1 0\n\
            vt 0 0\nvn 0 0 1\nf 1/1/1 2//1 3/7\nf -3 -2 4 -1 # a vertex to come\nf 1 2\n\
            v 0 0 1";
        let polygons = parse(text).expect("legal");
        assert_eq!(
            polygons.positions,
            [
                [0.0, 0.0, 0.0],
                [1.5, 0.0, -0.2],
                [0.0, 1.0, 0.0],
                [0.0, 0.0, 1.0]
            ]
        );
        assert_eq!(polygons.corners, [0, 1, 2, 0, 1, 3, 2]);
        assert_eq!(polygons.ends, [3, 7]);
    }

    #[test]
    fn indices_from_the_end_count_from_where_they_stand() {
        let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 2 0 0\nf -1 -2 -3\n";
        assert_eq!(parse(text).expect("legal").corners, [0, 1, 2, 3, 2, 1]);
    }

    #[test]
    fn lines_go_on_after_a_backslash_and_end_in_any_way() {
        let expected = parse(b"v 0 0 1\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("legal");
        for text in [
            &b"v 0 0\\\n1\nv 1 \\\r\n 0 \\\n0\nv 0 1 0\nf 1 2 \\\n3"[..],
            b"v 0 0 1\rv 1 0 0\rv 0 1 0\rf 1 2 3\r",
            b"v 0 0 1\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\\",
        ] {
            assert_eq!(parse(text).expect("legal"), expected);
        }
    }

    #[test]
    fn nothing_is_nothing() {
        for text in [&b""[..], b"\n\n", b"\\", b"# f 1 2 3", b"vertex 1 2 3"] {
            assert_eq!(parse(text).expect("legal"), Polygons::default());
        }
    }

    #[test]
    fn the_line_at_fault_is_named() {
        let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        for (line, reason) in [
            ("f 1 2 4", "line 4: there is no vertex 4 among 3"),
            ("f 1 2 0", "line 4: there is no vertex 0 among 3"),
            ("f 1 2 -4", "line 4: there is no vertex -4 among 3"),
            (
                "f 1 2 x/1",
                "line 4: corner \"x/1\" of a face names no vertex",
            ),
            (
                "f 1 2 /1",
                "line 4: corner \"/1\" of a face names no vertex",
            ),
            (
                "v 1 2",
                "line 4: coordinate 2 of a vertex, \"\", is no number",
            ),
            (
                "v 1 1.#QNAN 0",
                "line 4: coordinate 1 of a vertex, \"1.#QNAN\", is no number",
            ),
        ] {
            let last = if line.starts_with('v') { 4 } else { 3 };
            let text = format!("{triangle}{line}\nf 1 2 {last}\n");
            assert_eq!(refusal(text.as_bytes()), reason);
        }
        assert!(refusal(b"v \xff\xfe 0 0\nf 1 1 1").starts_with("line 1: coordinate 0"));
    }

    #[test]
    fn what_no_polygon_uses_need_not_be_a_place() {
        let text = b"v x 0 0\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 2\nf 2 3 4\n";
        let polygons = parse(text).expect("legal");
        assert_eq!(polygons.positions.len(), 5);
        assert!(polygons.positions[0].iter().all(|x| x.is_nan()));
        assert_eq!(polygons.positions[2], [1.0, 0.0, 0.0]);
        assert!(polygons.positions[4].iter().all(|x| x.is_nan()));
    }
}
