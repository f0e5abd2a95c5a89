//! HTML that every page has: the document around its body, and tables.

use std::fmt::Write;

use super::plot::escaped;

const STYLE: &str = include_str!("style.css");

/// A page that needs nothing else; title and body are HTML.
pub(super) fn document(title: &str, body: &str) -> String {
    // No line ends between a number and its sign.
    let body = body.replace(" %", "\u{a0}%");
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n{body}</main>\n</body>\n</html>\n"
    )
}

/// A time of [`super::zone::Zone::minute`], of which no line ends within the date.
pub(super) fn time(text: &str) -> String {
    match text.split_once(' ') {
        Some((date, rest)) => format!("<span class=\"date\">{}</span> {}", escaped(date), escaped(rest)),
        None => escaped(text),
    }
}

/// A table with heads, each with the class of its column; the rows are HTML.
pub(super) fn table(caption: &str, heads: &[(&str, &str)], rows: &str) -> String {
    table_of_class("", caption, heads, rows)
}

/// A table whose rows become one block each where the screen is narrow; the cells are HTML, the first of a row is its head.
pub(super) fn wide_table(caption: &str, heads: &[(&str, &str)], rows: &[Vec<String>]) -> String {
    let mut html = String::new();
    for row in rows {
        html += "<tr>";
        for (n, (cell, (head, class))) in row.iter().zip(heads).enumerate() {
            let _ = match n {
                0 => write!(html, "<th scope=\"row\">{cell}</th>"),
                _ => write!(html, "<td class=\"{class}\" data-head=\"{head}\">{cell}</td>"),
            };
        }
        html += "</tr>\n";
    }
    table_of_class("wide", caption, heads, &html)
}

fn table_of_class(class: &str, caption: &str, heads: &[(&str, &str)], rows: &str) -> String {
    let heads: String = heads
        .iter()
        .map(|(head, class)| format!("<th scope=\"col\" class=\"{class}\">{head}</th>"))
        .collect();
    format!(
        "<div class=\"scroll\"><table class=\"{class}\"><caption>{}</caption><thead><tr>{heads}</tr></thead>\
         <tbody>\n{rows}</tbody></table></div>\n",
        escaped(caption)
    )
}
