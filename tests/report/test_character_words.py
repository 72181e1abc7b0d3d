"""How captions name a character: with the charts of its face."""

from replicate.report.pose_record import with_layout


def test_a_name_is_followed_by_the_charts_that_the_face_lies_in():
    assert with_layout("teen@one_face", ("face", "neck", "tooth_1")) == "teen@one_face (face in one chart)"
    assert with_layout("teen", ("face_1", "face_2", "cranium")) == "teen (face in 2 charts)"


def test_a_head_without_charts_of_such_names_has_its_name_alone():
    assert with_layout("rigify", ("head", "surface")) == "rigify"
