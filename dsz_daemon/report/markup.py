"""HTML as a tree: text can't be forgotten to be escaped, because it is never markup. Pure."""

from __future__ import annotations

from xml.etree.ElementTree import Element, tostring


def element(tag: str, *children: str | Element, **attributes: str) -> Element:
    """Build an element; strings become text. `class_` is the class, `data_x` is `data-x`.

    >>> tostring(element("p", "a < b ", element("b", "&"), "!", class_="note"), encoding="unicode")
    '<p class="note">a &lt; b <b>&amp;</b>!</p>'
    """
    node = Element(tag, {name.rstrip("_").replace("_", "-"): text for name, text in attributes.items()})
    for child in children:
        if isinstance(child, Element):
            node.append(child)
        elif len(node):
            node[-1].tail = (node[-1].tail or "") + child
        else:
            node.text = (node.text or "") + child
    return node


def script(source: str) -> Element:
    """Build a script from our own or plotly's source.

    Raises ValueError for a source that would end its own element.
    """
    if "</script" in source.lower():
        raise ValueError("a script must not contain its own end tag")
    return element("script", source)


def data_block(name: str, json_text: str) -> Element:
    """Build a block of JSON that the page's script reads; `<` is written so that no tag can occur."""
    return element("script", json_text.replace("<", "\\u003c"), type="application/json", id=name)


def document(head: Element, body: Element) -> bytes:
    """Serialise a page; characters that UTF-8 can't carry (broken file names) become escapes."""
    text = tostring(element("html", head, body, lang="en"), encoding="unicode", method="html")
    return ("<!doctype html>\n" + text + "\n").encode("utf-8", "backslashreplace")
