from __future__ import annotations

import shlex
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

import simple_ros
from simple_ros import arguments
from simple_ros.arguments import Arguments, BadArgument, parse_arguments
from simple_ros.errors import ConfigError, InvalidName, SimpleRosError
from simple_ros.parameters.errors import BadParameterText


def told(words: str, name: str = "talker", namespace: str = "") -> arguments.NodeArguments:
    return Arguments.parse(words).of(name, namespace)


class TestNames:
    def test_name_and_namespace(self) -> None:
        scope = told("__name:=bob __ns:=/robot1").scope
        assert (scope.node, scope.namespace) == ("robot1/bob", "robot1")

    def test_the_namespace_of_the_program_holds_unless_it_is_told_another(self) -> None:
        assert told("", namespace="/a").scope.node == "a/talker"
        assert told("__ns:=b", namespace="a").scope.node == "b/talker"
        assert told("__ns:=/", namespace="a").scope.node == "talker"

    def test_a_leading_slash_is_absolute(self) -> None:
        assert told("", name="/talker", namespace="a").scope.node == "talker"
        assert told("__name:=/bob __ns:=a").scope.node == "bob"

    def test_words_for_one_node(self) -> None:
        words = "talker:__name:=t listener:__name:=l talker:chatter:=news listener:_x:=1"
        assert told(words).scope.node == "t"
        assert told(words).scope.remaps == {"chatter": "news"}
        assert told(words).overrides == {}
        assert told(words, "listener").overrides == {"l/x": 1}

    def test_only_the_first_node_is_renamed(self) -> None:
        found = Arguments.parse("__name:=a other:__name:=b _x:=1").without_name()
        assert found.of("first").scope.node == "first"
        assert found.of("other").scope.node == "b"
        assert found.of("first").overrides == {"first/x": 1}


class TestRemaps:
    def test_both_sides_are_in_the_namespace_of_the_node(self) -> None:
        scope = told("__ns:=/r chatter:=news /abs:=rel ~own:=/glob odom:=~odom").scope
        assert scope.resolve("chatter") == "r/news"
        assert scope.resolve("/r/chatter") == "r/news"
        assert scope.resolve("/chatter") == "chatter"
        assert scope.resolve("/abs") == "r/rel"
        assert scope.resolve("~own") == "glob"
        assert scope.resolve("odom") == "r/talker/odom"

    def test_without_a_namespace_the_slash_means_nothing(self) -> None:
        for words in ("/a:=b", "a:=/b", "a:=b"):
            scope = told(words).scope
            assert scope.resolve("a") == scope.resolve("/a") == "b"

    def test_once_only(self) -> None:
        scope = told("a:=b b:=a").scope
        assert (scope.resolve("a"), scope.resolve("b")) == ("b", "a")

    def test_the_later_word_wins(self) -> None:
        assert told("a:=b a:=c").scope.resolve("a") == "c"


class TestParameters:
    @pytest.mark.parametrize(
        ("word", "expected"),
        [
            ("_gain:=1", {"talker/gain": 1}),
            ("_gain:=1e3", {"talker/gain": 1000.0}),
            ("_a/b:=true", {"talker/a/b": True}),
            ("_a.b:=x", {"talker/a/b": "x"}),
            ("_pid:={p: 1, limits: {low: 0.5}}", {"talker/pid/p": 1, "talker/pid/limits/low": 0.5}),
            ("_l:=[1, 2.5]", {"talker/l": [1.0, 2.5]}),
            ("_s:=", {"talker/s": ""}),
            ("_url:=a:=b", {"talker/url": "a:=b"}),
        ],
    )
    def test_values_are_yaml(self, word: str, expected: dict[str, object]) -> None:
        found = parse_arguments([word]).of("talker").overrides
        assert repr(found) == repr(expected)

    def test_files(self) -> None:
        text = """
        talker: {gain: 2}
        /**: {gain: 1, common: x}
        /robot1/driver: {ros__parameters: {gain: 3}}
        robot1: {arm: {ros__parameters: {gain: 4}}}
        """
        found = parse_arguments(["__params:=f.yaml", "_common:=y"], lambda _: text)
        assert found.of("talker").overrides == {"talker/gain": 2, "talker/common": "y"}
        assert found.of("driver", "robot1").overrides["robot1/driver/gain"] == 3
        assert found.of("arm", "robot1").overrides["robot1/arm/gain"] == 4
        assert found.of("other").overrides["other/gain"] == 1

    def test_a_file_for_one_node_is_still_for_its_nodes(self) -> None:
        found = parse_arguments(["a:__params:=f"], lambda _: "/**: {x: 1}\nb: {y: 2}")
        assert found.of("a").overrides == {"a/x": 1}
        assert found.of("b").overrides == {}

    def test_a_file_that_is_wrong(self) -> None:
        with pytest.raises(BadParameterText, match=r"f\.yaml:2: .*name 'a-b'"):
            parse_arguments(["__params:=f.yaml"], lambda _: "talker:\n  a-b: 1")


class TestErrors:
    @pytest.mark.parametrize(
        ("word", "position", "reason"),
        [
            ("__nme:=x", 0, "did you mean '__name'?"),
            ("t:__zzz:=x", 2, "there are __name"),
            ("__name:=9x", 8, "digit"),
            ("__ns:=a//b", 8, "slashes"),
            ("_g-n:=1", 2, "'-'"),
            ("_gain:=[1, x]", 7, "mixes int and string"),
            ("_gain:='", 7, "no YAML"),
            ("_gain:=null", 7, "cannot be null"),
            ("chat ter:=x", 4, "' '"),
            ("a:=", 3, "empty"),
            ("a:=b!", 4, "'!'"),
            (":=a", 0, "empty"),
            ("t-x:a:=b", 1, "'-'"),
            ("__log_level:=loud", 13, "none of debug"),
            ("__params:=/no/such/file", 10, "No such file"),
            ("word", 4, "no ':='"),
        ],
    )
    def test_the_caret_is_under_what_is_wrong(self, word: str, position: int, reason: str) -> None:
        with pytest.raises(BadArgument) as caught:
            parse_arguments([word])
        error = caught.value
        assert isinstance(error, ValueError)
        assert isinstance(error, SimpleRosError)
        assert (error.word, error.position) == (word, position)
        assert reason in error.reason
        shown, caret = str(error).splitlines()[-2:]
        assert shown[: caret.index("^")].endswith(repr(word[:position])[1:-1])

    def test_names_of_the_program_too(self) -> None:
        with pytest.raises(InvalidName):
            Arguments().of("a b")
        with pytest.raises(InvalidName, match="namespace"):
            Arguments().of("a", "b c")

    @given(st.text())
    def test_no_word_does_anything_else_than_mean_something_or_be_refused(self, word: str) -> None:
        try:
            parse_arguments([word], lambda _: word).of("talker", "ns")
        except (BadArgument, BadParameterText):
            pass


class TestProcess:
    @pytest.fixture(autouse=True)
    def fresh(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(arguments, "_process", arguments._Process())
        monkeypatch.setattr(sys, "argv", ["prog"])
        monkeypatch.delenv(arguments.ENVIRONMENT, raising=False)

    def test_environment_then_command_line(self, monkeypatch: pytest.MonkeyPatch) -> None:
        words = ["_text:=two words", "_a:=1", "_b:=1"]
        monkeypatch.setenv(arguments.ENVIRONMENT, shlex.join(words))
        monkeypatch.setattr(sys, "argv", ["prog", "--rate", "_b:=2", "file"])
        found = arguments.process_arguments().of("n").overrides
        assert found == {"n/text": "two words", "n/a": 1, "n/b": 2}
        assert simple_ros.argv() == ["prog", "--rate", "file"]

    def test_the_first_node_has_the_name(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv(arguments.ENVIRONMENT, "__name:=a __ns:=r")
        assert arguments.process_arguments().of("x").scope.node == "r/a"
        assert arguments.process_arguments().of("x").scope.node == "r/x"

    def test_programs_with_words_of_their_own(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(sys, "argv", ["prog", "data: a:=b"])
        monkeypatch.setenv(arguments.ENVIRONMENT, "__name:=a")
        arguments.use_environment_only()
        assert arguments.process_arguments().of("x").scope.node == "a"

    def test_an_environment_that_is_no_words(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv(arguments.ENVIRONMENT, "_a:='1")
        with pytest.raises(ConfigError, match="SIMPLE_ROS_ARGS"):
            arguments.process_arguments()
