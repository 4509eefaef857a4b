//! Single changes: `key.sub=value`.

use std::ops::Range;

use super::tree::{Item, Node, SyntaxError};

/// Parses `key.sub=value` into nested tables.
pub fn parse_change(argument: &str, layer: usize) -> Result<Node, SyntaxError> {
    let at = argument.find('=').ok_or_else(|| SyntaxError {
        message: "there is no `=` here".to_owned(),
        span: 0..argument.len(),
    })?;
    let (key, value) = (&argument[..at], argument[at + 1..].trim());
    let whole = Node::parse(argument, layer);
    if let (Ok(node), Ok(only)) = (&whole, Node::parse(&format!("{key}=0"), layer))
        && !sets_only(node, &only)
    {
        return Err(SyntaxError {
            message: "one change at a time".to_owned(),
            span: 0..argument.len(),
        });
    }
    let end = argument.trim_end().len();
    let span = end - value.len()..end;
    // Not a number, however it is spelt, is no word either.
    if value.parse::<f64>().is_ok_and(f64::is_nan) {
        return Err(SyntaxError {
            message: "this is not a number".to_owned(),
            span,
        });
    }
    let is_word = !value.is_empty() && !value.contains(['"', '\'', '[', ']', '{', '}', '\n', '#']);
    match whole {
        Err(_) if is_word => {
            let mut node = Node::parse(&format!("{key}=0"), layer)?;
            replace_leaf(&mut node, value, span);
            Ok(node)
        }
        other => other,
    }
}

/// Whether `node` has no keys beside those of the chain of tables `only`, whatever is at its end.
fn sets_only(node: &Node, only: &Node) -> bool {
    match (&node.item, &only.item) {
        (Item::Table(entries), Item::Table(chain)) => {
            entries.len() == chain.len()
                && chain
                    .iter()
                    .all(|(key, below)| node.child(key).is_some_and(|child| sets_only(child, below)))
        }
        (_, end) => !matches!(end, Item::Table(_)),
    }
}

/// Puts the word at the end of a chain of tables with one entry each.
fn replace_leaf(node: &mut Node, word: &str, span: Range<usize>) {
    match &mut node.item {
        Item::Table(entries) => entries
            .iter_mut()
            .for_each(|(_, child)| replace_leaf(child, word, span.clone())),
        item => {
            *item = Item::String(word.to_owned());
            node.origin.value = span;
        }
    }
}
