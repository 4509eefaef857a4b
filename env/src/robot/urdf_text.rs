//! Checks of a URDF's text, element by element, so that every fault is reported with its line.

use std::collections::HashMap;

use roxmltree::{Document, Node, ParsingOptions};

use super::source::{RobotError, Source};

/// Most links, and most joints, that a URDF may have.
const MAX_LINKS: usize = 1000;
/// Deepest nesting of XML elements. A URDF needs five levels, embedded simulator blocks a few more.
const MAX_DEPTH: usize = 64;

/// Most attributes of an element: a reader compares each with every other. A URDF's have ten at most.
const MAX_ATTRIBUTES: usize = 100;

/// Largest magnitude of a number other than a limit, SI units: beyond it lie mistakes and overflow.
const MAX_NUMBER: f64 = 1e9;

/// Attributes that hold finite numbers: element, attribute, how many.
const NUMBERS: [(&str, &str, usize); 25] = [
    ("origin", "xyz", 3),
    ("origin", "rpy", 3),
    ("origin", "quat_xyzw", 4),
    ("mass", "value", 1),
    ("inertia", "ixx", 1),
    ("inertia", "ixy", 1),
    ("inertia", "ixz", 1),
    ("inertia", "iyy", 1),
    ("inertia", "iyz", 1),
    ("inertia", "izz", 1),
    ("box", "size", 3),
    ("sphere", "radius", 1),
    ("cylinder", "radius", 1),
    ("cylinder", "length", 1),
    ("capsule", "radius", 1),
    ("capsule", "length", 1),
    ("axis", "xyz", 3),
    ("limit", "lower", 1),
    ("limit", "upper", 1),
    ("limit", "effort", 1),
    ("limit", "velocity", 1),
    ("mimic", "multiplier", 1),
    ("mimic", "offset", 1),
    ("dynamics", "damping", 1),
    ("dynamics", "friction", 1),
];

/// Attributes without which an element means nothing.
const REQUIRED: [(&str, &[&str]); 13] = [
    ("link", &["name"]),
    ("joint", &["name", "type"]),
    ("parent", &["link"]),
    ("child", &["link"]),
    ("mass", &["value"]),
    ("inertia", &["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]),
    ("box", &["size"]),
    ("sphere", &["radius"]),
    ("cylinder", &["radius", "length"]),
    ("capsule", &["radius", "length"]),
    ("mimic", &["joint"]),
    ("axis", &["xyz"]),
    ("limit", &["velocity"]),
];

/// Child elements without which an element means nothing.
const CHILDREN: [(&str, &[&str]); 4] = [
    ("joint", &["parent", "child"]),
    ("inertial", &["mass", "inertia"]),
    ("collision", &["geometry"]),
    ("visual", &["geometry"]),
];

/// Child elements that an element has once at most.
const ONCE: [(&str, &[&str]); 5] = [
    ("link", &["inertial"]),
    (
        "joint",
        &["parent", "child", "origin", "axis", "limit", "mimic", "dynamics"],
    ),
    ("inertial", &["origin", "mass", "inertia"]),
    ("collision", &["origin", "geometry"]),
    ("visual", &["origin", "geometry"]),
];

/// A link of the text.
pub(super) type Element<'a> = Node<'a, 'a>;

/// Parses the text and checks nesting, counts, names, required parts and numbers.
/// Returns the links and the joints in the order of the text.
pub(super) fn check<'a>(
    source: &'a Source,
    document: &'a Document<'a>,
) -> Result<(Vec<Element<'a>>, Vec<Element<'a>>), RobotError> {
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        return Err(source.error(
            root.range(),
            format!("the root element is <{}>", root.tag_name().name()),
            "a URDF's root element is <robot name=\"...\">",
        ));
    }
    check_depth(source, root)?;
    let named = |tag| {
        root.children()
            .filter(|node| node.has_tag_name(tag))
            .collect::<Vec<_>>()
    };
    let (links, joints) = (named("link"), named("joint"));
    for (tag, elements) in [("link", &links), ("joint", &joints)] {
        if let Some(extra) = elements.get(MAX_LINKS) {
            let message = format!("more than {MAX_LINKS} <{tag}> elements");
            return Err(source.error(extra.range(), message, "merge what does not move"));
        }
        for element in elements {
            element
                .descendants()
                .filter(|node| node.is_element() && !is_stray_mass(*node))
                .try_for_each(|node| check_element(source, node))?;
        }
        check_names(source, tag, elements)?;
    }
    if links.is_empty() {
        return Err(source.error(
            root.range(),
            "the robot has no links",
            "a robot has at least one <link>",
        ));
    }
    Ok((links, joints))
}

/// Parses XML without document type definitions.
pub(super) fn parse(source: &Source) -> Result<Document<'_>, RobotError> {
    check_attributes(source)?;
    Document::parse_with_options(&source.text, ParsingOptions::default()).map_err(|error| {
        let at = error.pos();
        let line = source
            .text
            .split_inclusive('\n')
            .take(at.row.saturating_sub(1) as usize);
        let start = line.map(str::len).sum::<usize>() + at.col.saturating_sub(1) as usize;
        source.error(
            start..start,
            format!("not XML: {error}"),
            "a URDF is an XML file; close what is open here",
        )
    })
}

/// Refuses nesting that would make recursive readers overflow. Walks the tree without recursion.
fn check_depth(source: &Source, root: Node) -> Result<(), RobotError> {
    let (mut node, mut depth) = (root, 0);
    loop {
        if depth > MAX_DEPTH {
            let message = format!("elements are nested more than {MAX_DEPTH} deep");
            return Err(source.error(node.range(), message, "a URDF's links and joints are flat"));
        }
        if let Some(child) = node.first_child() {
            (node, depth) = (child, depth + 1);
            continue;
        }
        while node != root && node.next_sibling().is_none() {
            let Some(parent) = node.parent() else { return Ok(()) };
            (node, depth) = (parent, depth - 1);
        }
        match node.next_sibling() {
            Some(sibling) if node != root => node = sibling,
            _ => return Ok(()),
        }
    }
}

/// Refuses elements with very many attributes before any reader of XML sees them, whose time grows with the square of their number
/// (RUSTSEC-2026-0194).
fn check_attributes(source: &Source) -> Result<(), RobotError> {
    let text = &source.text;
    let mut at = 0;
    while let Some(start) = text[at..].find('<').map(|i| at + i) {
        let rest = &text[start..];
        let closed = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")];
        if let Some((_, end)) = closed.iter().find(|(begin, _)| rest.starts_with(begin)) {
            at = rest.find(end).map_or(text.len(), |i| start + i + end.len());
            continue;
        }
        let (mut quote, mut attributes, mut end) = (None, 0, rest.len());
        for (i, c) in rest.char_indices() {
            match (quote, c) {
                (Some(open), _) if c == open => quote = None,
                (Some(_), _) => {}
                (None, '"' | '\'') => quote = Some(c),
                (None, '=') => attributes += 1,
                (None, '>') => {
                    end = i + 1;
                    break;
                }
                (None, _) => {}
            }
        }
        if attributes > MAX_ATTRIBUTES {
            let message = format!("an element has more than {MAX_ATTRIBUTES} attributes");
            return Err(source.error(start..start, message, "the elements of a URDF have ten at most"));
        }
        at = start + end;
    }
    Ok(())
}

/// Exporters leave a `<mass>` of their own in the link, beside the `<inertial>` that counts.
fn is_stray_mass(node: Node) -> bool {
    node.has_tag_name("mass") && node.parent().is_some_and(|parent| parent.has_tag_name("link"))
}

fn check_element(source: &Source, node: Node) -> Result<(), RobotError> {
    let tag = node.tag_name().name();
    let mut required = REQUIRED
        .iter()
        .filter(|(element, _)| *element == tag)
        .flat_map(|(_, names)| *names);
    if let Some(name) = required.find(|name| !node.has_attribute(**name)) {
        let message = format!("<{tag}> has no `{name}`");
        return Err(source.error(node.range(), message, format!("write <{tag} {name}=\"...\">")));
    }
    let mut children = CHILDREN
        .iter()
        .filter(|(element, _)| *element == tag)
        .flat_map(|(_, names)| *names);
    if let Some(name) = children.find(|name| !node.children().any(|child| child.has_tag_name(**name))) {
        let message = format!("<{tag}> has no <{name}>");
        return Err(source.error(node.range(), message, format!("add a <{name}> element")));
    }
    for name in ONCE
        .iter()
        .filter(|(element, _)| *element == tag)
        .flat_map(|(_, names)| *names)
    {
        if let Some(second) = node.children().filter(|child| child.has_tag_name(*name)).nth(1) {
            let message = format!("a second <{name}> in one <{tag}>");
            return Err(source.error(second.range(), message, "leave one of the two"));
        }
    }
    for (_, name, count) in NUMBERS.iter().filter(|(element, ..)| *element == tag) {
        let Some(attribute) = node.attribute_node(*name) else {
            continue;
        };
        let numbers: Option<Vec<f64>> = attribute
            .value()
            .split_whitespace()
            .map(|word| word.parse().ok())
            .collect();
        let largest = if tag == "limit" { f64::MAX } else { MAX_NUMBER };
        let what = match numbers {
            None => "is not a number",
            Some(numbers) if numbers.len() != *count => "has the wrong number of values",
            Some(numbers) if !numbers.iter().all(|number| number.is_finite()) => "is not finite",
            Some(numbers) if numbers.iter().any(|number| number.abs() > largest) => "is too large",
            Some(_) => continue,
        };
        let message = format!("`{name}` of <{tag}> {what}: \"{}\"", attribute.value());
        return Err(source.error(attribute.range(), message, format!("give {count} finite number(s)")));
    }
    Ok(())
}

fn check_names(source: &Source, tag: &str, elements: &[Element]) -> Result<(), RobotError> {
    let mut seen = HashMap::new();
    for element in elements {
        let name = element.attribute("name").unwrap_or_default();
        if name.is_empty() {
            return Err(source.error(element.range(), format!("a <{tag}> without a name"), "give it a name"));
        }
        if let Some(first) = seen.insert(name, element) {
            let line = element.document().text_pos_at(first.range().start).row;
            let message = format!("the name `{name}` is given to two <{tag}> elements, first on line {line}");
            return Err(source.error(element.range(), message, format!("each {tag} has a name of its own")));
        }
    }
    Ok(())
}
